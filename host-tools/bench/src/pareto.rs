//! Who is beaten by nobody.

/// For each (time, error): no other is at least as good in both and better in one. NaN is beaten by everybody.
///
/// ```
/// use isobath_bench::pareto::front;
/// assert_eq!(front(&[(1.0, 9.0), (2.0, 3.0), (3.0, 3.0), (4.0, 1.0)]), [true, true, false, true]);
/// assert_eq!(front(&[(1.0, f64::NAN), (2.0, 2.0)]), [false, true]);
/// ```
#[must_use]
pub fn front(points: &[(f64, f64)]) -> Vec<bool> {
    let beats = |a: &(f64, f64), b: &(f64, f64)| a.0 <= b.0 && a.1 <= b.1 && (a.0 < b.0 || a.1 < b.1);
    points.iter().map(|p| !p.0.is_nan() && !p.1.is_nan() && !points.iter().any(|other| beats(other, p))).collect()
}

#[cfg(test)]
mod tests {
    use super::front;

    #[test]
    fn equals_share_the_front() {
        assert_eq!(front(&[(1.0, 1.0), (1.0, 1.0)]), [true, true]);
        assert_eq!(front(&[]), [false; 0]);
        assert_eq!(front(&[(f64::NAN, 0.0)]), [false]);
    }
}
