//! What a device lends to the job when it is measured, and the run that prints the figures.
//!
//! Lines of words, for `cargo xtask firmware` to read and for people. Numbers are written by hand: `core::fmt` would link panics
//! that the core does without.

use core::hint::black_box;

use isobath::glam::Vec3;

use crate::answers::Check;
use crate::lighting::{self, LightMemory, Surroundings};
use crate::others::{self, Scratch};
use crate::sizes;
use crate::{Job, Memory, Packed, Probe, Stage};

/// A device with a clock, a stack and a way to say something.
pub trait Device {
    /// Instructions a tick of the clock, as a fraction, under QEMU's `-icount shift=0`.
    const INSTRUCTIONS: (u64, u64);

    /// Starts the clock at 0.
    fn start(&mut self);

    /// Ticks since then.
    fn ticks(&self) -> u64;

    /// Fills the free stack with a pattern.
    fn paint(&mut self);

    /// Bytes of stack that have been in use since: the high-water mark.
    fn used(&self) -> usize;

    /// Prints.
    fn print(&mut self, text: &str);

    /// Spends so many instructions, to check the clock with.
    fn spend(&mut self, instructions: u32);
}

/// A frame and the bits of the host's answers.
pub type Known<'a> = (Packed<'a>, &'a [u32]);

/// All the memory there is.
#[derive(Debug)]
pub struct Everything {
    /// The job's.
    pub job: Memory,
    /// The other capabilities'.
    pub scratch: Scratch,
    /// The light's.
    pub light: LightMemory,
}

impl Everything {
    /// Zeros.
    pub const NEW: Self = Self { job: Memory::NEW, scratch: Scratch::NEW, light: LightMemory::NEW };
}

/// Runs every frame and what else is measured; whether all answers were the host's.
pub fn run<D: Device>(
    device: &mut D,
    memory: &mut Everything,
    centre: [f32; 3],
    frames: impl Iterator<Item = Known<'static>>,
    others: &[u32],
    light: (&Surroundings<'static>, &[u32]),
) -> bool {
    let Everything { job: memory, scratch, light: light_memory } = memory;
    let mut meter = Meter { device };
    for (name, bytes) in sizes::SIZED.iter().flatten().chain(&sizes::FIXED) {
        meter.line(&[("size", Word::Text(name)), ("bytes", Word::Number(*bytes as u64))]);
    }
    meter.calibrate();
    let mut passed = true;
    let mut last = None;
    {
        let Ok(mut job) = Job::new(memory, Vec3::from(centre)) else { return false };
        for (i, (packed, answers)) in frames.enumerate() {
            meter.line(&[("frame", Word::Number(i as u64))]);
            let mut check = Check::new(answers);
            passed &= job.frame(black_box(&packed), &mut meter, &mut check).is_ok();
            passed &= meter.verdict(&check);
            last = Some(packed);
        }
    }
    let Some(packed) = last else { return false };
    meter.line(&[("others", Word::Number(0))]);
    let mut check = Check::new(others);
    passed &= others::measure(black_box(&packed), memory, scratch, &mut meter, &mut check).is_ok();
    passed &= meter.verdict(&check);
    meter.line(&[("lighting", Word::Number(0))]);
    let (around, answers) = light;
    let mut check = Check::new(answers);
    passed &= lighting::measure(black_box(around), light_memory, &mut meter, &mut check).is_ok();
    passed & meter.verdict(&check)
}

/// Instructions that the clock is checked with.
const CALIBRATION: u32 = 1_000_000;

/// Counts a stage's instructions and its stack, and says so.
struct Meter<'d, D> {
    device: &'d mut D,
}

#[derive(Clone, Copy)]
enum Word {
    Text(&'static str),
    Number(u64),
}

impl<D: Device> Meter<'_, D> {
    fn line(&mut self, words: &[(&'static str, Word)]) {
        for (i, (name, word)) in words.iter().enumerate() {
            self.device.print(if i == 0 { "" } else { " " });
            self.device.print(name);
            self.device.print(" ");
            match word {
                Word::Text(text) => self.device.print(text),
                Word::Number(number) => self.number(*number),
            }
        }
        self.device.print("\n");
    }

    fn number(&mut self, mut number: u64) {
        const DIGITS: [&str; 10] = ["0", "1", "2", "3", "4", "5", "6", "7", "8", "9"];
        let mut digits = [0_u8; 20];
        let mut count = 0;
        for digit in &mut digits {
            *digit = (number % 10) as u8;
            number /= 10;
            count += 1;
            if number == 0 {
                break;
            }
        }
        for digit in digits.iter().take(count).rev() {
            self.device.print(DIGITS.get(usize::from(*digit)).copied().unwrap_or("?"));
        }
    }

    fn verdict(&mut self, check: &Check<'_>) -> bool {
        let passed = check.passed();
        self.line(&[
            ("answers", Word::Text(if passed { "equal" } else { "DIFFER" })),
            ("compared", Word::Number(check.compared.into())),
            ("ulps", Word::Number(check.worst.into())),
        ]);
        if let Some((what, ours, host)) = check.first {
            self.line(&[
                ("first", Word::Text(what)),
                ("bits", Word::Number(ours.into())),
                ("host", Word::Number(host.into())),
            ]);
        }
        passed
    }

    /// A known number of instructions, as the clock sees them.
    fn calibrate(&mut self) {
        self.device.start();
        self.device.spend(CALIBRATION);
        let ticks = self.device.ticks();
        self.line(&[("calibration", Word::Number(instructions::<D>(ticks))), ("of", Word::Number(CALIBRATION.into()))]);
    }
}

fn instructions<D: Device>(ticks: u64) -> u64 {
    let (instructions, per) = D::INSTRUCTIONS;
    ticks * instructions / per
}

impl<D: Device> Probe for Meter<'_, D> {
    fn stage<R>(&mut self, stage: Stage, work: impl FnOnce() -> R) -> R {
        self.device.paint();
        self.device.start();
        let answer = apart(work);
        let ticks = self.device.ticks();
        let stack = self.device.used();
        self.line(&[
            ("stage", Word::Text(stage.name)),
            ("times", Word::Number(stage.times.into())),
            ("unit", Word::Text(stage.unit)),
            ("budgeted", Word::Number(stage.budgeted.into())),
            ("instructions", Word::Number(instructions::<D>(ticks))),
            ("stack", Word::Number(stack as u64)),
        ]);
        answer
    }
}

/// In a frame of its own, so that the stage's stack is not the caller's.
#[inline(never)]
fn apart<R>(work: impl FnOnce() -> R) -> R {
    work()
}
