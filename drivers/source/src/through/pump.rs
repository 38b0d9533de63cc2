//! A thread that reads a source ahead of its caller: no frame waits in the camera because the caller computes, the caller decides what is dropped, and
//! may hold frames.
//!
//! The pool is made at the start: as many frames as the [policy](BackPressure::pool) says. A frame is in exactly one place: free, being filled,
//! waiting, or held. They change places by swapping, without copying pixels and without allocating.

use std::collections::VecDeque;
use std::ops::Deref;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::clock::{Clock, Deadline, HostNanos, SystemClock};
use crate::error::SourceError;
use crate::frame::OwnedFrame;
use crate::policy::BackPressure;
use crate::source::{DepthSource, Gap, Outcome, SourceInfo};
use crate::stats::StreamStats;

/// How long the thread waits for a frame before it looks whether it should stop.
const LOOK_UP: Duration = Duration::from_millis(50);

#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "nearly all items are frames, and boxing one would allocate")]
enum Item {
    Frame(OwnedFrame, HostNanos),
    Gap(Gap),
    Failed(SourceError),
}

#[derive(Debug, Default)]
struct State {
    free: VecDeque<OwnedFrame>,
    waiting: VecDeque<Item>,
    frames_waiting: usize,
    held: usize,
    stop: bool,
    /// The thread is done: nothing comes any more.
    ended: bool,
    /// Why, when the device went.
    gone: Option<String>,
    inner: StreamStats,
    delivered: u64,
    dropped: u64,
    max_latency: Duration,
}

#[derive(Debug, Default)]
struct Shared {
    state: Mutex<State>,
    /// Something waits, or the thread ended.
    filled: Condvar,
    /// A frame became free, or the thread should stop.
    freed: Condvar,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        // The state is whole between statements: a panic elsewhere does not spoil it.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    /// The oldest waiting frame's memory, its place and all.
    fn steal_oldest(&mut self) -> Option<OwnedFrame> {
        let at = self.waiting.iter().position(|item| matches!(item, Item::Frame(..)))?;
        let Some(Item::Frame(frame, _)) = self.waiting.remove(at) else { return None };
        self.frames_waiting -= 1;
        self.dropped += 1;
        Some(frame)
    }

    /// Queues what is no frame. A caller that never asks must not make it grow: the oldest of a hundred is forgotten.
    fn tell(&mut self, item: Item) {
        if self.waiting.len() - self.frames_waiting >= NEWS {
            let old = self.waiting.iter().position(|item| !matches!(item, Item::Frame(..)));
            old.map(|at| self.waiting.remove(at));
        }
        self.waiting.push_back(item);
    }
}

/// Gaps and errors that may wait.
const NEWS: usize = 100;

/// A source read by a thread of its own.
#[derive(Debug)]
pub struct Pumped<S> {
    info: SourceInfo,
    policy: BackPressure,
    shared: Arc<Shared>,
    idle: Option<S>,
    thread: Option<JoinHandle<(S, Result<(), SourceError>)>>,
}

/// A frame that is held: reads as an [`OwnedFrame`], and goes back to its stream when dropped. It may outlive the stream.
#[derive(Debug)]
pub struct FrameLease {
    frame: OwnedFrame,
    shared: Arc<Shared>,
}

impl Deref for FrameLease {
    type Target = OwnedFrame;
    fn deref(&self) -> &OwnedFrame {
        &self.frame
    }
}

impl Drop for FrameLease {
    fn drop(&mut self) {
        let mut state = self.shared.lock();
        state.held -= 1;
        let frame = std::mem::take(&mut self.frame);
        state.free.push_back(frame);
        drop(state);
        self.shared.freed.notify_one();
    }
}

impl<S: DepthSource + Send + 'static> Pumped<S> {
    /// Around a source, which is started with this one.
    #[must_use]
    pub fn new(source: S, policy: BackPressure) -> Self {
        let info = source.info().clone();
        Self { info, policy, shared: Arc::new(Shared::default()), idle: Some(source), thread: None }
    }

    /// The next frame, to hold: no pixel is copied. There is a lease exactly when the outcome is [`Outcome::Frame`].
    ///
    /// # Errors
    /// [`SourceError::LeaseLimit`] when as many are held as may be; else as [`DepthSource::next_into`].
    pub fn lease(&mut self, deadline: Deadline) -> Result<(Outcome, Option<FrameLease>), SourceError> {
        self.start()?;
        let limit = BackPressure::lease_limit(self.policy.pool());
        if self.shared.lock().held >= limit {
            return Err(SourceError::LeaseLimit { limit });
        }
        let mut frame = OwnedFrame::new();
        let outcome = self.take(&mut frame, deadline)?;
        let lease = (outcome == Outcome::Frame).then(|| {
            self.shared.lock().held += 1;
            FrameLease { frame, shared: Arc::clone(&self.shared) }
        });
        Ok((outcome, lease))
    }

    /// Swaps the next frame into `frame`; when it was one, the old memory of `frame` is the caller's to give back.
    fn take(&self, frame: &mut OwnedFrame, deadline: Deadline) -> Result<Outcome, SourceError> {
        let mut state = self.shared.lock();
        loop {
            match state.waiting.pop_front() {
                Some(Item::Frame(next, arrived)) => {
                    state.frames_waiting -= 1;
                    state.delivered += 1;
                    let waited = SystemClock.now().saturating_since(arrived);
                    state.max_latency = state.max_latency.max(waited);
                    *frame = next;
                    // There is room in the queue for one more.
                    self.shared.freed.notify_one();
                    return Ok(Outcome::Frame);
                }
                Some(Item::Gap(gap)) => return Ok(Outcome::Recovered(gap)),
                Some(Item::Failed(error)) => return Err(error),
                None => {}
            }
            if state.ended {
                return match &state.gone {
                    Some(device) => Err(SourceError::Disconnected { device: device.clone() }),
                    None => Ok(Outcome::EndOfStream),
                };
            }
            state = match deadline.remaining(SystemClock.now()) {
                Some(Duration::ZERO) => return Ok(Outcome::TimedOut),
                Some(left) => self.shared.filled.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0,
                None => self.shared.filled.wait(state).unwrap_or_else(PoisonError::into_inner),
            };
        }
    }
}

impl<S: DepthSource + Send + 'static> DepthSource for Pumped<S> {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn start(&mut self) -> Result<(), SourceError> {
        let Some(source) = self.idle.as_mut() else { return Ok(()) };
        source.start()?;
        let pool = self.policy.pool();
        // Leases of an earlier run give their frames back to its own state.
        self.shared = Arc::new(Shared::default());
        {
            let mut state = self.shared.lock();
            state.free.reserve_exact(pool + 1);
            // Most sources give 16-bit depth; for the others a frame takes its memory when it is filled first.
            let (width, height) = self.info.size.unwrap_or_default();
            state.free.extend((0..pool).map(|_| {
                let mut frame = OwnedFrame::new();
                frame.depth_u16_mut(width, height);
                frame
            }));
            state.waiting.reserve_exact(pool + NEWS);
        }
        let Some(source) = self.idle.take() else { return Ok(()) };
        let (shared, policy) = (Arc::clone(&self.shared), self.policy);
        let thread = std::thread::Builder::new().name("isobath-pump".into());
        let spawned = thread.spawn(move || run(source, &shared, policy));
        self.thread = Some(spawned.map_err(|e| SourceError::io(self.info.path.clone(), e))?);
        Ok(())
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        let Some(thread) = self.thread.take() else { return Ok(()) };
        self.shared.lock().stop = true;
        self.shared.freed.notify_all();
        match thread.join() {
            Ok((source, result)) => {
                self.idle = Some(source);
                let mut state = self.shared.lock();
                while let Some(frame) = state.steal_oldest() {
                    state.free.push_back(frame);
                }
                state.waiting.clear();
                result
            }
            Err(panic) => std::panic::resume_unwind(panic),
        }
    }

    fn stats(&self) -> StreamStats {
        let state = self.shared.lock();
        let mut stats = state.inner;
        // Frames that wait are in no count yet.
        stats.delivered = state.delivered;
        stats.dropped_by_policy += state.dropped;
        stats.max_latency = stats.max_latency.max(state.max_latency);
        stats
    }

    fn next_into(&mut self, frame: &mut OwnedFrame, deadline: Deadline) -> Result<Outcome, SourceError> {
        self.start()?;
        let mut next = OwnedFrame::new();
        let outcome = self.take(&mut next, deadline)?;
        if outcome == Outcome::Frame {
            // The caller's old memory becomes a free frame of the pool.
            std::mem::swap(frame, &mut next);
            self.shared.lock().free.push_back(next);
            self.shared.freed.notify_one();
        }
        Ok(outcome)
    }
}

impl<S> Drop for Pumped<S> {
    fn drop(&mut self) {
        self.shared.lock().stop = true;
        self.shared.freed.notify_all();
        if let Some(thread) = self.thread.take() {
            // A panic of the thread was printed where it happened.
            let _ = thread.join();
        }
    }
}

/// The thread: fills free frames until told to stop, or the stream ends.
fn run<S: DepthSource>(mut source: S, shared: &Shared, policy: BackPressure) -> (S, Result<(), SourceError>) {
    /// Whoever waits for the thread is told that it is gone, even when it panicked.
    struct Ends<'a>(&'a Shared);
    impl Drop for Ends<'_> {
        fn drop(&mut self) {
            self.0.lock().ended = true;
            self.0.filled.notify_all();
        }
    }
    let _ends = Ends(shared);
    let depth = policy.pool() - 2;
    let mut own: Option<OwnedFrame> = None;
    loop {
        let mut state = shared.lock();
        let mut frame = loop {
            if state.stop {
                drop(state);
                let stopped = source.stop();
                let mut state = shared.lock();
                state.inner = source.stats();
                state.ended = true;
                drop(state);
                shared.filled.notify_all();
                return (source, stopped);
            }
            if let Some(frame) = own.take() {
                break frame;
            }
            // With no policy but the newest, a full queue gives up its oldest; otherwise the source waits, and loses what comes meanwhile.
            if policy == BackPressure::Latest || state.frames_waiting < depth {
                if let Some(frame) = state.free.pop_front() {
                    break frame;
                }
                if policy == BackPressure::Latest
                    && let Some(frame) = state.steal_oldest()
                {
                    break frame;
                }
            }
            state = shared.freed.wait(state).unwrap_or_else(PoisonError::into_inner);
        };
        drop(state);

        let result = source.next_into(&mut frame, Deadline::after(&SystemClock, LOOK_UP));
        let stats = source.stats();
        let mut state = shared.lock();
        state.inner = stats;
        match result {
            Ok(Outcome::Frame) => {
                if policy == BackPressure::Latest {
                    while let Some(old) = state.steal_oldest() {
                        state.free.push_back(old);
                    }
                }
                state.waiting.push_back(Item::Frame(frame, SystemClock.now()));
                state.frames_waiting += 1;
            }
            Ok(Outcome::TimedOut) => own = Some(frame),
            Ok(Outcome::Recovered(gap)) => {
                own = Some(frame);
                state.tell(Item::Gap(gap));
            }
            Ok(Outcome::EndOfStream) => state.ended = true,
            Err(error) if error.is_terminal() => {
                if let SourceError::Disconnected { device } = &error {
                    state.gone = Some(device.clone());
                }
                state.ended = true;
            }
            Err(error) => {
                own = Some(frame);
                state.tell(Item::Failed(error));
            }
        }
        let ended = state.ended;
        drop(state);
        shared.filled.notify_all();
        if ended {
            let stopped = source.stop();
            return (source, stopped);
        }
    }
}
