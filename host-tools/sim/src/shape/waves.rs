//! Wavy height fields: y = sum of a sin(k x cos d + k z sin d + phase), over a rectangle of x and z.
//!
//! The slope is bounded by sum(a k), so a ray at height g above the surface can't meet it before g / (|dy| + slope |dxz|):
//! it steps that far, at least a 32nd of the shortest wave, and where the sign turned, bisects to rounding.

use super::{Ray, Touch};
use crate::maths::{V3, v3};

/// One sine wave.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wave {
    pub(crate) amplitude: f64,
    /// Radians per metre, in x and z.
    pub(crate) k: [f64; 2],
    pub(crate) phase: f64,
}

/// The field.
#[derive(Debug, Clone)]
pub(crate) struct Waves {
    pub(crate) half: [f64; 2],
    pub(crate) waves: Vec<Wave>,
}

const MAX_STEPS: usize = 4096;

impl Waves {
    fn height(&self, x: f64, z: f64) -> f64 {
        self.waves.iter().map(|w| w.amplitude * libm::sin(w.k[0] * x + w.k[1] * z + w.phase)).sum()
    }

    pub(crate) fn normal(&self, x: f64, z: f64) -> V3 {
        let (mut dx, mut dz) = (0.0, 0.0);
        for w in &self.waves {
            let c = w.amplitude * libm::cos(w.k[0] * x + w.k[1] * z + w.phase);
            dx += c * w.k[0];
            dz += c * w.k[1];
        }
        v3(-dx, 1.0, -dz).unit_or_up()
    }

    pub(crate) fn half(&self) -> V3 {
        v3(self.half[0], self.waves.iter().map(|w| w.amplitude.abs()).sum(), self.half[1])
    }

    pub(super) fn intersect(&self, ray: &Ray, near: f64, far: f64) -> Option<Touch> {
        // The part of the ray within the field's box.
        let (mut t, mut end) = (near, far);
        let half = self.half();
        for i in 0..3 {
            let (o, d, h) = (ray.origin.axis(i), ray.direction.axis(i), half.axis(i));
            if d == 0.0 {
                if o.abs() > h {
                    return None;
                }
                continue;
            }
            let (a, b) = ((-h - o) / d, (h - o) / d);
            t = t.max(a.min(b));
            end = end.min(a.max(b));
        }
        if !(t <= end) {
            return None;
        }
        let across = (ray.direction.x * ray.direction.x + ray.direction.z * ray.direction.z).sqrt();
        let number = |w: &Wave| (w.k[0] * w.k[0] + w.k[1] * w.k[1]).sqrt();
        let slope: f64 = self.waves.iter().map(|w| w.amplitude.abs() * number(w)).sum();
        let fastest = self.waves.iter().map(number).fold(0.0, f64::max);
        let speed = ray.direction.y.abs() + slope * across;
        let least = if fastest * across > 0.0 { std::f64::consts::TAU / fastest / 32.0 / across } else { end - t };
        let gap = |t: f64| {
            let p = ray.at(t);
            p.y - self.height(p.x, p.z)
        };
        let start = gap(t);
        let (mut low, mut low_gap) = (t, start);
        for _ in 0..MAX_STEPS {
            let next = (low + (low_gap.abs() / speed).max(least)).min(end);
            let next_gap = gap(next);
            if (next_gap > 0.0) != (start > 0.0) {
                let t = bisect(gap, low, next, start > 0.0);
                return (t > near && t < far).then_some(Touch { t, part: 0 });
            }
            if next >= end {
                return None;
            }
            (low, low_gap) = (next, next_gap);
        }
        None
    }
}

fn bisect(gap: impl Fn(f64) -> f64, mut low: f64, mut high: f64, low_is_above: bool) -> f64 {
    for _ in 0..64 {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if (gap(middle) > 0.0) == low_is_above {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn agrees_with_a_fine_march() {
        let field = Waves {
            half: [1.0, 1.0],
            waves: vec![
                Wave { amplitude: 0.05, k: [9.0, 2.0], phase: 0.3 },
                Wave { amplitude: 0.02, k: [-5.0, 14.0], phase: 1.0 },
            ],
        };
        let r = Random::new(3);
        let mut hits = 0;
        for i in 0..400 {
            let n = |k: u64| r.normal(i * 8 + k);
            let from = v3(n(0), 1.0 + n(1).abs(), n(2));
            let ray = Ray { origin: from, direction: v3(n(3) * 0.6, 0.0, n(4) * 0.6) - from };
            let hit = field.intersect(&ray, 0.0, 10.0);
            let marched = (0..40_000).map(|i| f64::from(i) * 5e-5).find(|&t| {
                let p = ray.at(t);
                p.x.abs() <= 1.0 && p.z.abs() <= 1.0 && p.y < field.height(p.x, p.z) && t > 0.0
            });
            match (hit, marched) {
                (Some(h), Some(m)) => {
                    hits += 1;
                    assert!((h.t - m).abs() < 1e-4, "{h:?} {m}");
                    let p = ray.at(h.t);
                    assert!((p.y - field.height(p.x, p.z)).abs() < 1e-14);
                }
                (None, None) => {}
                // Only at the rim, where the march enters from the side.
                (h, m) => {
                    let p = ray.at(m.or(h.map(|h| h.t)).unwrap_or(0.0));
                    assert!(p.x.abs().max(p.z.abs()) > 0.9, "{h:?} {m:?} {p:?}");
                }
            }
        }
        assert!(hits > 100, "{hits}");
    }
}
