//! A Butterworth low-pass of second order over several signals at once, in a form that single precision bears.
//!
//! VQF (Laidig and Seel 2023, section 3.3) smooths over seconds what arrives hundreds of times a second. In the usual difference equation the
//! output is then a small difference of large products: its coefficients are 1 plus a few millionths, and in `f32` half of their digits are gone;
//! implementations keep that filter in `f64`. Here the same transfer function (the bilinear transform of w^2 / (s^2 + sqrt(2) w s + w^2) with
//! w = sqrt(2) / tau) runs as two trapezoidal integrators (Zavalishin, "The Art of VA Filter Design", 2012, section 4: the state variable
//! filter without delay in its loop). Its coefficients are of the size of what they multiply, its states are values of the signal rather than
//! of the past, so the period may change from step to step; and what a sum of the slow integrator loses to rounding is kept for the next.
//!
//! The first `tau` seconds give the mean of what came: the filter starts settled.
//!
//! Memory: 12 bytes a signal, and 8. Cost: 14 operations a signal, in lanes. Error against the difference equation in `f64`: see the tests.

/// What the period makes of the time constant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Gains {
    period: f32,
    one: f32,
    two: f32,
    three: f32,
}

impl Gains {
    pub(super) const NONE: Self = Self { period: 0.0, one: 1.0, two: 0.0, three: 0.0 };

    /// For a period and time constant in seconds, above 0. Computed anew only when the period is another.
    #[inline]
    pub(super) fn follow(&mut self, period: f32, tau: f32) {
        if period != self.period {
            *self = Self::new(period, tau);
        }
    }

    /// The period that they are for, seconds.
    #[inline]
    pub(super) const fn period(&self) -> f32 {
        self.period
    }

    fn new(period: f32, tau: f32) -> Self {
        // tan(w T / 2) by its continued fraction: to 1e-6 below 1/2. A period so long that this is not near (above 0.7 tau) is held there:
        // the cutoff is then no longer exact, and there was little to smooth.
        let x = crate::ground::math::min(period / (core::f32::consts::SQRT_2 * tau), 0.5);
        let squared = x * x;
        let g = x * (15.0 - squared) / (15.0 - 6.0 * squared);
        let one = 1.0 / (1.0 + g * (g + core::f32::consts::SQRT_2));
        Self { period, one, two: g * one, three: g * g * one }
    }
}

/// N signals with one time constant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LowPass<const N: usize> {
    /// The fast integrator.
    fast: [f32; N],
    /// The slow one, the output's; while starting, the mean.
    slow: [f32; N],
    /// What `slow` lost to rounding.
    lost: [f32; N],
    /// Seconds since the start, until they are tau.
    elapsed: f32,
    /// Readings since the start, until tau is over; then 0.
    count: f32,
}

impl<const N: usize> LowPass<N> {
    pub(super) const NEW: Self = Self { fast: [0.0; N], slow: [0.0; N], lost: [0.0; N], elapsed: 0.0, count: 1.0 };

    /// Takes a reading of each signal, `gains.period` after the one before; gives the outputs.
    #[inline]
    pub(super) fn step(&mut self, input: &[f32; N], gains: &Gains, tau: f32) -> [f32; N] {
        if self.count > 0.0 {
            return self.start(input, gains.period, tau);
        }
        let mut output = self.slow;
        let states = self.fast.iter_mut().zip(&mut self.slow).zip(&mut self.lost);
        for (((fast, slow), lost), (x, y)) in states.zip(input.iter().zip(&mut output)) {
            let off = x - *slow;
            let band = gains.one * *fast + gains.two * off;
            let half = gains.two * *fast + gains.three * off;
            *y = *slow + half;
            *fast = 2.0 * band - *fast;
            let change = 2.0 * half + *lost;
            let next = *slow + change;
            *lost = change - (next - *slow);
            *slow = next;
        }
        output
    }

    /// The mean so far.
    #[cold]
    fn start(&mut self, input: &[f32; N], period: f32, tau: f32) -> [f32; N] {
        for (mean, x) in self.slow.iter_mut().zip(input) {
            *mean += (x - *mean) / self.count;
        }
        self.count += 1.0;
        self.elapsed += period;
        if self.elapsed >= tau {
            self.count = 0.0;
        }
        self.slow
    }

    /// The share of the starting time that is over, 0 to 1.
    pub(super) fn settled(&self, tau: f32) -> f32 {
        if self.count > 0.0 { self.elapsed / tau } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::println;
    use std::vec::Vec;

    /// The difference equation, in f64, of the bilinear transform.
    fn plainly(input: &[f64], period: f64, tau: f64) -> Vec<f64> {
        let c = (period / (2.0_f64.sqrt() * tau)).tan();
        let d = c * c + 2.0_f64.sqrt() * c + 1.0;
        let (b0, a1, a2) = (c * c / d, 2.0 * (c * c - 1.0) / d, (1.0 - 2.0_f64.sqrt() * c + c * c) / d);
        let n = (tau / period).ceil() as usize;
        let mut out = Vec::new();
        let (mut x1, mut x2, mut y1, mut y2) = (0.0, 0.0, 0.0, 0.0);
        let mut sum = 0.0;
        for (i, &x) in input.iter().enumerate() {
            let y = if i < n {
                sum += x;
                let mean = sum / (i + 1) as f64;
                (x1, x2, y1, y2) = (mean, mean, mean, mean);
                mean
            } else {
                let y = b0 * (x + 2.0 * x1 + x2) - a1 * y1 - a2 * y2;
                (x2, x1, y2, y1) = (x1, x, y1, y);
                y
            };
            out.push(y);
        }
        out
    }

    #[test]
    fn agrees_with_the_difference_equation_in_f64() {
        for (period, tau) in [(0.01_f32, 3.0_f32), (1.0 / 256.0, 3.0), (0.00025, 3.0), (0.005, 0.05), (0.02, 0.05)] {
            let n = 200_000;
            let mut seed = 1_u32;
            let input: Vec<f64> = (0..n)
                .map(|i| {
                    seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    let noise = f64::from(seed >> 8) / f64::from(1 << 24) - 0.5;
                    let slow = (i as f64 * f64::from(period) * 0.7).sin();
                    // As the filter sees it, f32.
                    f64::from((9.8 + 0.3 * slow + noise) as f32)
                })
                .collect();
            let expected = plainly(&input, f64::from(period), f64::from(tau));
            let mut filter = LowPass::<4>::NEW;
            let mut gains = Gains::NONE;
            let mut worst = 0.0_f64;
            for (i, (x, y)) in input.iter().zip(&expected).enumerate() {
                gains.follow(period, tau);
                let x = *x as f32;
                let out = filter.step(&[x, -x, 1.0, 0.0], &gains, tau);
                assert!(out[0] == -out[1] && (out[2] - 1.0).abs() < 1e-6 && out[3] == 0.0);
                // The reference starts by counting readings, this one seconds: a reading more or less. It dies away.
                if i as f32 * period > tau * 12.0 {
                    worst = worst.max((f64::from(out[0]) - y).abs());
                }
            }
            println!("period {period} s, tau {tau} s: worst {worst:e}");
            assert!(worst < 1e-5, "period {period}, tau {tau}: {worst:e}");
        }
    }

    #[test]
    fn the_period_may_change() {
        // A ramp: the output runs after it by tau, whatever the periods.
        let mut filter = LowPass::<1>::NEW;
        let (mut gains, mut t, mut out) = (Gains::NONE, 0.0_f64, 0.0);
        for i in 0..40_000 {
            let period = if i % 3 == 0 { 0.0021_f32 } else { 0.0009 };
            t += f64::from(period);
            gains.follow(period, 0.5);
            out = f64::from(filter.step(&[t as f32], &gains, 0.5)[0]);
        }
        assert!((t - out - 0.5).abs() < 1e-3, "{}", t - out);
    }
}
