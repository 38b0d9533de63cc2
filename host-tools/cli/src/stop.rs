//! Ctrl-C: the frame in work is finished, and so are files. Pressed again, it ends the program at once.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether somebody wants an end.
#[derive(Debug, Clone, Default)]
pub(crate) struct Stop(Arc<AtomicBool>);

impl Stop {
    /// From now on Ctrl-C (and a polite kill) asks for an end. One of these a program.
    pub(crate) fn on_ctrl_c() -> Self {
        let stop = Self::default();
        let asked = Arc::clone(&stop.0);
        // Where signals can't be caught, Ctrl-C does what it always does.
        let _ = ctrlc::set_handler(move || {
            if asked.swap(true, Ordering::Relaxed) {
                std::process::exit(130);
            }
        });
        stop
    }

    pub(crate) fn asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
