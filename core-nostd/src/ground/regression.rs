//! Least squares of w = c + a x + b y over pixels: the plane of inverse depth.

use super::math;

/// Sums over readings; x and y are pixel offsets, w any value (subtract a reference first: squares lose the digits of
/// large ones).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Sums {
    pub(crate) n: f32,
    pub(crate) x: f32,
    pub(crate) y: f32,
    pub(crate) w: f32,
    pub(crate) xx: f32,
    pub(crate) xy: f32,
    pub(crate) yy: f32,
    pub(crate) xw: f32,
    pub(crate) yw: f32,
    pub(crate) ww: f32,
}

/// The plane through the readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Regression {
    /// Value at the origin of the offsets.
    pub(crate) c: f32,
    /// Slope along x.
    pub(crate) a: f32,
    /// Slope along y.
    pub(crate) b: f32,
    /// Sum of squared residuals.
    pub(crate) squares: f32,
}

impl Sums {
    /// One reading more. Kernels over whole tiles sum many at a time.
    pub(crate) fn add(&mut self, x: f32, y: f32, w: f32) {
        self.n += 1.0;
        self.x += x;
        self.y += y;
        self.w += w;
        self.xx += x * x;
        self.xy += x * y;
        self.yy += y * y;
        self.xw += x * w;
        self.yw += y * w;
        self.ww += w * w;
    }

    /// `None` when there are fewer than three readings, or all lie on one line.
    pub(crate) fn solve(&self) -> Option<Regression> {
        let n = self.n;
        if n < 3.0 {
            return None;
        }
        let (mx, my, mw) = (self.x / n, self.y / n, self.w / n);
        let (xx, xy, yy) = (self.xx - n * mx * mx, self.xy - n * mx * my, self.yy - n * my * my);
        let (xw, yw, ww) = (self.xw - n * mx * mw, self.yw - n * my * mw, self.ww - n * mw * mw);
        let det = xx * yy - xy * xy;
        // Offsets are whole pixels apart: below this they lie on a line (zero, but for rounding).
        if det < 0.5 {
            return None;
        }
        let a = (xw * yy - yw * xy) / det;
        let b = (yw * xx - xw * xy) / det;
        Some(Regression { c: mw - a * mx - b * my, a, b, squares: math::max(ww - a * xw - b * yw, 0.0) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_is_returned_and_a_line_refused() {
        let mut sums = Sums::default();
        for i in 0..25 {
            let (x, y) = ((i % 5) as f32 - 1.0, (i / 5) as f32 - 3.0);
            sums.add(x, y, 0.5 + 0.25 * x - 0.125 * y);
        }
        let r = sums.solve().unwrap();
        assert!((r.c - 0.5).abs() < 1e-6 && (r.a - 0.25).abs() < 1e-6 && (r.b + 0.125).abs() < 1e-6);
        assert!(r.squares < 1e-5);
        let mut line = Sums::default();
        for i in 0..9 {
            line.add(i as f32, 2.0 * i as f32, 1.0);
        }
        assert_eq!(line.solve(), None);
        assert_eq!(Sums::default().solve(), None);
    }
}
