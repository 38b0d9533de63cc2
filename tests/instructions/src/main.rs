//! Runs one of the core's hot kernels on an input that is the same everywhere, for `cargo xtask instructions` to count.
//!
//! ```text
//! isobath-instructions             lists the kernels: name, answers in one run, what an answer is about
//! isobath-instructions KERNEL      runs it once
//! ```
//!
//! Under `valgrind --tool=callgrind --toggle-collect=*counted_part*` only what happens inside [`counted_part`] is counted, to
//! the instruction: rooms are built and pyramids stacked outside of it. Each kernel has a process of its own, so that adding one
//! moves no other's memory.
//!
//! | module | idea |
//! |---|---|
//! | [`room`] | what is looked at |
//! | [`pixels`] | kernels over every pixel |
//! | [`queries`] | kernels that answer one question at a time |
//! | [`maps`] | kernels that build or search a map |
//! | [`light`] | the environment's light |

use std::hint::black_box;
use std::process::ExitCode;

mod light;
mod maps;
mod pixels;
mod queries;
mod room;

/// One kernel.
struct Kernel {
    /// Lower case with hyphens: the key in `baseline.toml`.
    name: &'static str,
    /// Answers that one run gives.
    answers: usize,
    /// What one answer is about.
    unit: &'static str,
    /// Sets up, and calls [`counted`] once.
    run: fn(),
}

/// Runs the kernel proper: what is counted. It returns something that depends on its answers, so that they are needed.
fn counted<T>(mut kernel: impl FnMut() -> T) {
    counted_part(&mut || {
        black_box(kernel());
    });
}

/// The function that callgrind watches. Not inlined, or it would have no entry; it does something after the call, or
/// the call would become a jump and the exit be missed.
#[inline(never)]
fn counted_part(kernel: &mut dyn FnMut()) {
    kernel();
    black_box(0_u8);
}

fn all() -> impl Iterator<Item = &'static Kernel> {
    pixels::ALL.iter().chain(queries::ALL).chain(maps::ALL).chain(light::ALL)
}

fn main() -> ExitCode {
    let Some(name) = std::env::args().nth(1) else {
        for k in all() {
            println!("{} {} {}", k.name, k.answers, k.unit);
        }
        return ExitCode::SUCCESS;
    };
    let Some(kernel) = all().find(|k| k.name == name) else {
        eprintln!("no kernel `{name}`; without an argument they are listed");
        return ExitCode::from(2);
    };
    (kernel.run)();
    ExitCode::SUCCESS
}

#[cfg(test)]
mod tests {
    use super::all;

    #[test]
    fn names_are_unique_and_every_kernel_runs() {
        let mut names: Vec<_> = all().map(|k| k.name).collect();
        names.sort_unstable();
        let n = names.len();
        names.dedup();
        assert_eq!(names.len(), n);
        for k in all() {
            assert!(k.answers > 0 && !k.name.contains(' ') && !k.unit.contains(' '), "{}", k.name);
            (k.run)();
        }
    }
}
