//! Small dense linear algebra: which way may each view move, and how far.
//!
//! Unknowns are six a view: rotation vector and translation. Pairs of views couple them; a block elimination, last view first, leaves
//! in each pivot what is known of a view given the views before it, whatever the later ones do. Each pivot is decomposed in
//! its own scale (Gelfand et al. 2003: rotation times the radius of the view's points, about their middle), and what it does
//! not know is left out of the step (Zhang et al. 2016, "solution remapping").
//!
//! Matrices are nalgebra's; its eigenvalue solver is not used because it links a panic, Jacobi's rotations (Golub and Van
//! Loan, 8.5) do not, and find small eigenvalues to more digits.

use nalgebra::{Cholesky, Matrix3, Matrix6, Vector3, Vector6};

use crate::ground::math;

/// Eigenvalues, ascending, and the matrix of eigenvectors, column by column.
pub(super) fn eigen(symmetric: &Matrix6<f64>) -> ([f64; 6], Matrix6<f64>) {
    let mut m = *symmetric;
    let mut v = Matrix6::identity();
    for _ in 0..12 {
        let mut off = 0.0;
        for p in 0..5 {
            for q in p + 1..6 {
                off += m[(p, q)].abs();
            }
        }
        // Also ends on NaN.
        if !(off > 1e-17 * m.trace().abs()) {
            break;
        }
        for p in 0..5 {
            for q in p + 1..6 {
                rotate(&mut m, &mut v, p, q);
            }
        }
    }
    // Sorted by selection: six.
    let mut values = [0.0; 6];
    let mut vectors = Matrix6::zeros();
    let mut left = [true; 6];
    for k in 0..6 {
        let mut best = None;
        for (i, free) in left.iter().enumerate() {
            let value = m[(i.min(5), i.min(5))];
            if *free && best.is_none_or(|(_, b)| value < b) {
                best = Some((i.min(5), value));
            }
        }
        let Some((i, value)) = best else { break };
        if let (Some(free), Some(slot)) = (left.get_mut(i), values.get_mut(k)) {
            (*free, *slot) = (false, value);
        }
        for r in 0..6 {
            vectors[(r, k)] = v[(r, i)];
        }
    }
    (values, vectors)
}

/// One rotation in the plane of axes `p` and `q` that makes `m[(p, q)]` zero.
#[inline(always)]
fn rotate(m: &mut Matrix6<f64>, v: &mut Matrix6<f64>, p: usize, q: usize) {
    let apq = m[(p, q)];
    if apq == 0.0 {
        return;
    }
    let theta = (m[(q, q)] - m[(p, p)]) / (2.0 * apq);
    // The smaller root; for a huge theta the square overflows to infinity and t to 0, which is right.
    let t = theta.signum() / (theta.abs() + math::sqrt_f64(theta * theta + 1.0));
    let c = 1.0 / math::sqrt_f64(t * t + 1.0);
    let s = t * c;
    for k in 0..6 {
        let (a, b) = (m[(k, p)], m[(k, q)]);
        (m[(k, p)], m[(k, q)]) = (c * a - s * b, s * a + c * b);
    }
    for k in 0..6 {
        let (a, b) = (m[(p, k)], m[(q, k)]);
        (m[(p, k)], m[(q, k)]) = (c * a - s * b, s * a + c * b);
        let (a, b) = (v[(k, p)], v[(k, q)]);
        (v[(k, p)], v[(k, q)]) = (c * a - s * b, s * a + c * b);
    }
    (m[(p, q)], m[(q, p)]) = (0.0, 0.0);
}

/// The matrix of w x.
pub(super) fn cross(w: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -w.z, w.y, w.z, 0.0, -w.x, -w.y, w.x, 0.0)
}

/// The symmetric matrix of its upper triangle, row after row.
pub(super) fn symmetric(upper: &[f64; 21]) -> Matrix6<f64> {
    let mut m = Matrix6::zeros();
    let mut values = upper.iter();
    for p in 0..6 {
        for q in p..6 {
            let value = values.next().copied().unwrap_or(0.0);
            (m[(p, q)], m[(q, p)]) = (value, value);
        }
    }
    m
}

/// Six by six, from its four quarters.
fn quarters(a: &Matrix3<f64>, b: &Matrix3<f64>, c: &Matrix3<f64>, d: &Matrix3<f64>) -> Matrix6<f64> {
    let mut m = Matrix6::zeros();
    for p in 0..3 {
        for q in 0..3 {
            m[(p, q)] = a[(p, q)];
            m[(p, q + 3)] = b[(p, q)];
            m[(p + 3, q)] = c[(p, q)];
            m[(p + 3, q + 3)] = d[(p, q)];
        }
    }
    m
}

/// Takes (rotation, translation) of a world to that of the frame of a camera: `turn` and `t` are camera-to-world.
pub(super) fn into_camera(turn: &Matrix3<f64>, t: &Vector3<f64>) -> Matrix6<f64> {
    let back = turn.transpose();
    quarters(&back, &Matrix3::zeros(), &(-(back * cross(t))), &back)
}

/// What is believed of a camera's turn and shift beforehand: information, as of (rotation, translation of the origin), for
/// deviations `turn` (radians) and `shift` (metres) of a camera that stands at `t`.
pub(super) fn prior(t: &Vector3<f64>, turn: f64, shift: f64) -> Matrix6<f64> {
    let to_camera = quarters(&Matrix3::identity(), &Matrix3::zeros(), &(-cross(t)), &Matrix3::identity());
    let mut diagonal = Matrix6::zeros();
    for k in 0..3 {
        diagonal[(k, k)] = 1.0 / (turn * turn);
        diagonal[(k + 3, k + 3)] = 1.0 / (shift * shift);
    }
    to_camera.tr_mul(&diagonal) * to_camera
}

/// Where a view's points are: the scale in which its directions are compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Scale {
    /// Their middle, world.
    pub(super) centre: Vector3<f64>,
    /// Their root mean square distance from it, metres; above 0.
    pub(super) radius: f64,
}

impl Scale {
    /// Takes (radius x rotation, translation of the centre) to (rotation, translation of the origin).
    fn matrix(&self) -> Matrix6<f64> {
        let per = 1.0 / self.radius;
        let turn = Matrix3::identity() * per;
        quarters(&turn, &Matrix3::zeros(), &(cross(&self.centre) * per), &Matrix3::identity())
    }
}

/// A pivot, decomposed: what is known of a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Known {
    /// Inverse on the known directions, zero on the others.
    pub(super) inverse: Matrix6<f64>,
    /// Onto the unknown directions, each a column of (rotation, translation of the origin), their own lengths 1 in the scale; zero
    /// columns for the known.
    free: Matrix6<f64>,
    /// Eigenvalues over the weight, ascending: 1 is a plane faced by all residuals.
    pub(super) values: [f64; 6],
    /// Eigenvectors, as (rotation, translation of the centre), each a unit vector of (radius x rotation, translation).
    pub(super) directions: [Vector6<f64>; 6],
    /// How many of these, from the first, are not known.
    pub(super) unknown: usize,
}

impl Known {
    pub(super) const NOTHING: Self = Self {
        inverse: Matrix6::from_array_storage(nalgebra::ArrayStorage([[0.0; 6]; 6])),
        free: Matrix6::from_array_storage(nalgebra::ArrayStorage([[0.0; 6]; 6])),
        values: [0.0; 6],
        directions: [Vector6::from_array_storage(nalgebra::ArrayStorage([[0.0; 6]; 1])); 6],
        unknown: 6,
    };

    /// From an information matrix; directions whose eigenvalue over `weight` is below `least` count as not known. `prior` is
    /// information from elsewhere, that makes nothing known but slows what is.
    pub(super) fn of(information: &Matrix6<f64>, prior: &Matrix6<f64>, scale: &Scale, weight: f64, least: f64) -> Self {
        let to_plain = scale.matrix();
        let scaled = to_plain.tr_mul(information) * to_plain;
        let usable = weight > 0.0 && scale.radius > 0.0 && scaled.iter().all(|v| v.is_finite());
        if !usable {
            return Self::NOTHING;
        }
        let (values, vectors) = eigen(&scaled);
        let mut known = Self::NOTHING;
        known.unknown = 0;
        // Onto the known directions.
        let mut onto = Matrix6::zeros();
        for (i, (value, (said, direction))) in
            values.iter().zip(known.values.iter_mut().zip(&mut known.directions)).enumerate()
        {
            // Not `column`, whose check small builds keep.
            let column = Vector6::from_fn(|r, _| vectors[(r, i.min(5))]);
            *said = value / weight;
            *direction = column;
            if *said >= least && *value > 0.0 {
                onto += column * column.transpose();
            } else {
                known.unknown += 1;
                let plain = to_plain * column;
                for k in 0..6 {
                    known.free[(k, i.min(5))] = plain[k];
                }
            }
            for k in 0..3 {
                direction[k] /= scale.radius;
            }
        }
        // On the others any number above 0 makes it invertible; the weight is of the right size.
        let all = scaled + to_plain.tr_mul(prior) * to_plain;
        let whole = onto * all * onto + (Matrix6::identity() - onto) * weight;
        if let Some(factors) = Cholesky::new(whole) {
            // Column by column: of a whole matrix, small builds keep nalgebra's checks.
            let mut inverse = Matrix6::zeros();
            for c in 0..6 {
                let solved = factors.solve(&Vector6::from_fn(|r, _| onto[(r, c)]));
                for r in 0..6 {
                    inverse[(r, c)] = solved[r];
                }
            }
            known.inverse = to_plain * (onto * inverse) * to_plain.transpose();
        } else {
            known.unknown = 6;
        }
        known
    }

    /// The step along the unknown directions that leaves least of a correction `moved` (rotation, translation of the origin), as
    /// `prior` measures it.
    pub(super) fn least(&self, moved: &Vector6<f64>, prior: &Matrix6<f64>) -> Vector6<f64> {
        let mut normal = self.free.tr_mul(prior) * self.free;
        for k in 0..6 {
            if normal[(k, k)] == 0.0 {
                normal[(k, k)] = 1.0;
            }
        }
        let right = self.free.tr_mul(&(prior * moved));
        Cholesky::new(normal).map_or_else(Vector6::zeros, |f| self.free * f.solve(&-right))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn eigenvectors_are_orthonormal_and_belong_to_their_values(
            entries in proptest::array::uniform21(-1.0_f64..1.0), power in -20_i32..20,
        ) {
            let k = 10.0_f64.powi(power);
            let m = symmetric(&entries.map(|v| v * k));
            let (values, vectors) = eigen(&m);
            prop_assert!(values.windows(2).all(|w| w[0] <= w[1]));
            prop_assert!((vectors.transpose() * vectors - Matrix6::identity()).abs().max() < 1e-13);
            for (i, value) in values.iter().enumerate() {
                prop_assert!((m * vectors.column(i) - vectors.column(i) * *value).abs().max() < 1e-13 * k);
            }
        }
    }

    #[test]
    fn what_is_no_matrix_leaves_nothing_known() {
        let scale = Scale { centre: Vector3::zeros(), radius: 1.0 };
        let none = Matrix6::zeros();
        let nan = Matrix6::from_element(f64::NAN);
        assert_eq!(Known::of(&nan, &none, &scale, 1.0, 0.01), Known::NOTHING);
        assert_eq!(Known::of(&none, &none, &scale, 1.0, 0.01).unknown, 6);
        assert_eq!(Known::of(&Matrix6::identity(), &none, &scale, 0.0, 0.01), Known::NOTHING);
        let _ = eigen(&nan);
    }
}
