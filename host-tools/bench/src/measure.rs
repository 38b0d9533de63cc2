//! Timing. Methods take turns, so that what slows the machine down slows all of them down; of several rounds the best is
//! the time without disturbance, the median what one may expect. Where the system tells (Unix), the thread's own processor
//! time is counted, so that a busy machine does not show. Methods of other programs tell their own processor time.

use std::time::Duration;

use crate::report::Time;
use crate::row::Method;

/// How long to measure.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Effort {
    /// Turns each method gets.
    pub(crate) rounds: usize,
    /// A turn repeats a method until about this time is over.
    pub(crate) batch: Duration,
    /// No method gets much more than this in all, and at least two turns.
    pub(crate) longest: Duration,
}

/// Nanoseconds per unit of each method; NaN of one that could not run.
pub(crate) fn alternating(methods: &mut [Method<'_>], effort: &Effort) -> Vec<Time> {
    // Warms caches up, and tells how often to repeat: the second run does, as the first pays for memory never touched.
    let plans: Vec<(usize, usize)> = methods
        .iter_mut()
        .map(|method| {
            let Some(mut one) = method.spend(1, once) else { return (0, 0) };
            if one < effort.batch {
                one = method.spend(1, once).unwrap_or(one);
            }
            let one = one.max(Duration::from_nanos(20));
            let repeats = (effort.batch.as_nanos() / one.as_nanos()).clamp(1, 100_000) as usize;
            let turn = one.as_nanos() * repeats as u128;
            let turns = (effort.longest.as_nanos() / turn).clamp(2, effort.rounds.max(2) as u128) as usize;
            (repeats, turns)
        })
        .collect();
    let mut times: Vec<Vec<f64>> = methods.iter().map(|_| Vec::new()).collect();
    for round in 0..effort.rounds.max(2) {
        for ((method, &(repeats, turns)), list) in methods.iter_mut().zip(&plans).zip(&mut times) {
            if round >= turns {
                continue;
            }
            // What ran before it left its own data in the caches.
            if repeats > 1 {
                let _ = method.spend(1, once);
            }
            if let Some(time) = method.spend(repeats, once) {
                list.push(time.as_nanos() as f64 / (repeats * method.units()) as f64);
            }
        }
    }
    times.iter_mut().map(|list| Time::of(list)).collect()
}

fn once(what: &mut dyn FnMut()) -> Duration {
    let start = now();
    what();
    now().saturating_sub(start)
}

/// Time that this thread has had: others that use the same core don't count.
#[cfg(unix)]
fn now() -> Duration {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Duration::new(time.tv_sec.unsigned_abs(), u32::try_from(time.tv_nsec).unwrap_or(0))
}

/// Time since some moment.
#[cfg(not(unix))]
fn now() -> Duration {
    static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    START.get_or_init(std::time::Instant::now).elapsed()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::row::Score;
    use std::cell::Cell;

    /// Some work that the clock sees.
    fn busy() {
        let start = now();
        while now() - start < Duration::from_millis(2) {}
    }

    #[test]
    fn methods_take_turns_and_slow_ones_get_fewer() {
        let (a, b) = (Cell::new(0), Cell::new(0));
        let count = |c: &Cell<u32>| c.set(c.get() + 1);
        let score = || Score::of([0.0]);
        let mut methods =
            [Method::new("a", 10, || count(&a), score), Method::new("b", 1, || (busy(), count(&b)).1, score)];
        let effort = Effort { rounds: 5, batch: Duration::ZERO, longest: Duration::from_micros(100) };
        let times = alternating(&mut methods, &effort);
        assert_eq!(b.get(), 3, "once to warm up and the two turns everybody gets");
        assert!(a.get() >= 3 && times.iter().all(|t| t.best > 0.0 && t.best <= t.median));
    }
    #[test]
    fn who_tells_its_own_time_is_believed_and_who_fails_has_none() {
        let asked = Cell::new(0);
        let slow = |repeats: usize| {
            asked.set(asked.get() + repeats);
            Some(Duration::from_micros(70) * u32::try_from(repeats).unwrap())
        };
        let score = || Score::of([0.0]);
        let mut methods =
            [Method::told("slow", 7, "peer 1", slow, score), Method::told("gone", 7, "peer 2", |_| None, score)];
        let effort = Effort { rounds: 3, batch: Duration::from_millis(1), longest: Duration::from_secs(1) };
        let times = alternating(&mut methods, &effort);
        assert_eq!((times[0].best, times[0].median), (10_000.0, 10_000.0));
        assert_eq!(
            asked.get(),
            2 + 3 * (1 + 14),
            "twice to plan, then batches of a millisecond, each after a warm run"
        );
        assert!(times[1].best.is_nan());
    }
}
