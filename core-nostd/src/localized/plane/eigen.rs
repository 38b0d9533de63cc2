//! Eigenvalues and eigenvectors of a symmetric 3 x 3 matrix: cyclic Jacobi rotations (Golub and Van Loan, 8.5).
//!
//! Jacobi and not the closed form: the closed form loses half its digits when two eigenvalues are near each other, which is
//! the rule for a plane's covariance (a round patch). About 5 sweeps of 3 rotations; a plane fit calls it once.

use crate::ground::math;

/// The matrix, by its six different entries.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Symmetric {
    pub(super) xx: f64,
    pub(super) yy: f64,
    pub(super) zz: f64,
    pub(super) xy: f64,
    pub(super) xz: f64,
    pub(super) yz: f64,
}

/// One eigenvalue with its unit eigenvector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Eigen {
    pub(super) value: f64,
    pub(super) vector: [f64; 3],
}

/// One rotation that makes `a_pq` zero; `r` is the third axis.
fn rotate(
    app: &mut f64,
    aqq: &mut f64,
    apq: &mut f64,
    arp: &mut f64,
    arq: &mut f64,
    vp: &mut [f64; 3],
    vq: &mut [f64; 3],
) {
    if *apq == 0.0 {
        return;
    }
    let theta = (*aqq - *app) / (2.0 * *apq);
    // The smaller root; for a huge theta the square overflows to infinity and t to 0, which is right.
    let t = theta.signum() / (theta.abs() + math::sqrt_f64(theta * theta + 1.0));
    let c = 1.0 / math::sqrt_f64(t * t + 1.0);
    let s = t * c;
    *app -= t * *apq;
    *aqq += t * *apq;
    *apq = 0.0;
    (*arp, *arq) = (c * *arp - s * *arq, s * *arp + c * *arq);
    for (p, q) in vp.iter_mut().zip(vq) {
        (*p, *q) = (c * *p - s * *q, s * *p + c * *q);
    }
}

/// The three, smallest eigenvalue first.
pub(super) fn eigen(m: &Symmetric) -> [Eigen; 3] {
    let mut m = *m;
    let (mut x, mut y, mut z) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    // Converges quadratically: 6 sweeps reach f64 rounding, the rest is for odd scales.
    for _ in 0..12 {
        let off = m.xy.abs() + m.xz.abs() + m.yz.abs();
        if !(off > 1e-18 * (m.xx.abs() + m.yy.abs() + m.zz.abs())) {
            break;
        }
        rotate(&mut m.xx, &mut m.yy, &mut m.xy, &mut m.xz, &mut m.yz, &mut x, &mut y);
        rotate(&mut m.xx, &mut m.zz, &mut m.xz, &mut m.xy, &mut m.yz, &mut x, &mut z);
        rotate(&mut m.yy, &mut m.zz, &mut m.yz, &mut m.xy, &mut m.xz, &mut y, &mut z);
    }
    let mut all =
        [Eigen { value: m.xx, vector: x }, Eigen { value: m.yy, vector: y }, Eigen { value: m.zz, vector: z }];
    all.sort_unstable_by(|a, b| a.value.total_cmp(&b.value));
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn vectors_are_orthonormal_and_belong_to_their_values(
            e in proptest::array::uniform6(-1.0_f64..1.0), scale in -30_i32..30,
        ) {
            let k = 10.0_f64.powi(scale);
            let [xx, yy, zz, xy, xz, yz] = e.map(|v| v * k);
            let all = eigen(&Symmetric { xx, yy, zz, xy, xz, yz });
            prop_assert!(all[0].value <= all[1].value && all[1].value <= all[2].value);
            for (i, a) in all.iter().enumerate() {
                let v = a.vector;
                let mv = [
                    xx * v[0] + xy * v[1] + xz * v[2],
                    xy * v[0] + yy * v[1] + yz * v[2],
                    xz * v[0] + yz * v[1] + zz * v[2],
                ];
                for j in 0..3 {
                    prop_assert!((mv[j] - a.value * v[j]).abs() < 1e-13 * k);
                    let dot: f64 = (0..3).map(|n| v[n] * all[j].vector[n]).sum();
                    prop_assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-13);
                }
            }
        }
    }

    #[test]
    fn degenerate_matrices_give_axes() {
        for e in eigen(&Symmetric::default()) {
            assert_eq!(e.value, 0.0);
            assert_eq!(e.vector.iter().map(|v| v * v).sum::<f64>(), 1.0);
        }
    }
}
