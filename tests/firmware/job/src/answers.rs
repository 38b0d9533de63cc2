//! Answers as a row of numbers: the host writes them down, the device compares its own with them.

use isobath::glam::Vec3;
use isobath::ground::image::Image;
use isobath::localized::placement::Placement;
use isobath::localized::planner::Plan;

use crate::memory::Seen;

/// Largest difference of a device's number from the host's, in steps of the last digit (ulps). The core takes nothing from the
/// platform but the four operations, which IEEE 754 fixes, and libm, which is the same code everywhere: so none at all.
pub const ULPS: u32 = 0;

/// Takes the numbers, one by one.
pub trait Answers {
    /// A number; `what` is for people.
    fn number(&mut self, what: &'static str, value: f32);

    /// A whole number, below 2^24.
    fn count(&mut self, what: &'static str, value: usize) {
        self.number(what, value as f32);
    }

    /// Three numbers.
    fn vector(&mut self, what: &'static str, v: Vec3) {
        for value in v.to_array() {
            self.number(what, value);
        }
    }
}

/// Compares with what the host said.
#[derive(Debug)]
pub struct Check<'a> {
    expected: &'a [u32],
    /// Numbers compared.
    pub compared: u32,
    /// Largest difference met, ulps; `u32::MAX` when a number was missing or one of two was NaN.
    pub worst: u32,
    /// What differed by more than [`ULPS`] first, the device's bits and the host's.
    pub first: Option<(&'static str, u32, u32)>,
}

impl<'a> Check<'a> {
    /// Against the bits of the host's numbers.
    #[must_use]
    pub const fn new(expected: &'a [u32]) -> Self {
        Self { expected, compared: 0, worst: 0, first: None }
    }

    /// Whether all were as the host's, and none is left over.
    #[must_use]
    pub const fn passed(&self) -> bool {
        self.first.is_none() && self.expected.is_empty()
    }
}

impl Answers for Check<'_> {
    fn number(&mut self, what: &'static str, value: f32) {
        self.compared += 1;
        let host = self.expected.split_off_first().copied();
        let ulps = host.map_or(u32::MAX, |bits| ulps(value, f32::from_bits(bits)));
        self.worst = self.worst.max(ulps);
        if ulps > ULPS && self.first.is_none() {
            self.first = Some((what, value.to_bits(), host.unwrap_or(0)));
        }
    }
}

/// Floats between two numbers. Two NaN are equal, whatever their bits: which one an operation gives is the machine's choice.
#[must_use]
pub fn ulps(a: f32, b: f32) -> u32 {
    // Bits as a scale that counts through zero.
    let scale = |v: f32| {
        let bits = v.to_bits() as i32;
        if bits < 0 { i32::MIN.wrapping_sub(bits) } else { bits }
    };
    match (a.is_nan(), b.is_nan()) {
        (true, true) => 0,
        (false, false) => scale(a).abs_diff(scale(b)),
        _ => u32::MAX,
    }
}

/// Every fourth normal of every fourth row.
pub(crate) fn normals<const W: usize, const H: usize>(planes: &[Image<f32, W, H>; 3], out: &mut impl Answers) {
    for plane in planes {
        for value in plane.view().rows().step_by(4).flat_map(|row| row.iter().step_by(4)) {
            out.number("normals", *value);
        }
    }
}

pub(crate) fn hits(hits: &[Seen], out: &mut impl Answers) {
    for hit in hits {
        out.vector("hit, point", hit.point);
        out.vector("hit, normal", hit.normal);
        out.number("hit, sigma", hit.sigma);
    }
}

pub(crate) fn places(places: &[Option<Placement>], out: &mut impl Answers) {
    out.count("places found", places.iter().flatten().count());
    for place in places.iter().flatten() {
        out.vector("place", place.pose.centre);
        out.vector("place, normal", place.plane.normal());
        out.number("place, flatness", place.flatness);
        out.number("place, coverage", place.coverage);
    }
}

pub(crate) fn plan(plan: &Plan, points: &[Vec3], out: &mut impl Answers) {
    match plan {
        Plan::Found(path) => {
            out.number("path, length", path.length);
            out.number("path, cost", path.cost);
            out.count("path, expanded", path.expanded as usize);
            for point in points.iter().take(path.points) {
                out.vector("path, corner", *point);
            }
        }
        Plan::NoPath { expanded } => out.count("no path, expanded", *expanded as usize),
        Plan::StartUnknown => out.number("path", -1.0),
        Plan::StartBlocked => out.number("path", -2.0),
        Plan::GoalUnknown => out.number("path", -3.0),
        Plan::GoalBlocked => out.number("path", -4.0),
        _ => out.number("path", -5.0),
    }
}
