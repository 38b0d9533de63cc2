//! Depth recordings as sources. (The readers follow.)
