//! Which view is this? An id for each place that a frame was captured from, so that a store can replace like by like.
//!
//! LitAR keeps 3 to 5 views and replaces the one with the same id, or the one least recently observed (section 4.2.1). A view
//! is the same as a stored one when the device stands within 5 cm and 5 degrees of where that was captured; of several, the
//! nearest. A stored view keeps the pose it began with, however often it is seen again: someone who creeps along gets a new
//! view every 5 cm, not one that creeps with him.
//!
//! Memory: `V` x 40 bytes (48 where glam aligns quaternions to 16) and 16. Cost: `V` distances and arc tangents a call. Ids are 0 to `V` - 1: slots of a store.

use core::f32::consts::PI;
use core::fmt;

use crate::ground::rotation;
use crate::sensing::camera::Pose;

/// How near two poses must be to show the same view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewParams {
    /// Metres, 0 or more. Default 0.05.
    pub translation: f32,
    /// Radians, 0 to pi. Default 5 degrees.
    pub rotation: f32,
}

impl ViewParams {
    /// 5 cm and 5 degrees.
    pub const DEFAULT: Self = Self { translation: 0.05, rotation: 5.0 * PI / 180.0 };

    pub(super) fn check(&self) -> Result<(), PolicyError> {
        at_least_zero("translation", self.translation)?;
        if !(self.rotation >= 0.0 && self.rotation <= PI) {
            return Err(PolicyError { name: "rotation", value: self.rotation });
        }
        Ok(())
    }
}

impl Default for ViewParams {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// A parameter of a policy out of its range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PolicyError {
    /// The field at fault.
    pub name: &'static str,
    /// What it was.
    pub value: f32,
}

impl fmt::Display for PolicyError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "capture policy: {} = {} is not usable; lengths, times and accelerations must be 0 or more (not NaN), angles 0 to pi rad",
            self.name, self.value
        )
    }
}

impl core::error::Error for PolicyError {}

/// Refuses negative numbers and NaN.
pub(super) fn at_least_zero(name: &'static str, value: f32) -> Result<(), PolicyError> {
    if value >= 0.0 { Ok(()) } else { Err(PolicyError { name, value }) }
}

/// Which view a pose is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum View {
    /// One that is stored: replace what it holds, if you wish.
    Same(u16),
    /// A new one, in a slot that was free.
    New(u16),
    /// A new one, in the slot of the view that was least recently seen: what it held is another view.
    Replaced(u16),
}

impl View {
    /// Its id.
    #[must_use]
    pub const fn id(self) -> u16 {
        match self {
            Self::Same(id) | Self::New(id) | Self::Replaced(id) => id,
        }
    }

    /// Whether it was stored before.
    #[must_use]
    pub const fn is_new(self) -> bool {
        !matches!(self, Self::Same(_))
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Slot {
    pose: Pose,
    /// Tick of the last time it was seen; 0: free.
    seen: u32,
}

/// The ids of up to `V` views (at least 1, at most 65535: anything else does not compile).
///
/// ```
/// use glam::{Quat, Vec3};
/// use isobath::lighting::policy::views::{View, ViewIds, ViewParams};
/// use isobath::sensing::camera::Pose;
/// let mut ids = ViewIds::<2>::new(ViewParams::default())?;
/// let at = |x| Pose::new(Quat::IDENTITY, Vec3::X * x).unwrap();
/// assert_eq!(ids.see(&at(0.0)), View::New(0));
/// assert_eq!(ids.see(&at(1.0)), View::New(1));
/// assert_eq!(ids.see(&at(0.03)), View::Same(0));
/// assert_eq!(ids.see(&at(2.0)), View::Replaced(1)); // view 0 was seen later
/// # Ok::<(), isobath::lighting::policy::views::PolicyError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewIds<const V: usize> {
    params: ViewParams,
    slots: [Slot; V],
    tick: u32,
}

impl<const V: usize> ViewIds<V> {
    /// No view yet.
    ///
    /// # Errors
    /// [`PolicyError`] when a parameter is out of its range.
    pub fn new(params: ViewParams) -> Result<Self, PolicyError> {
        const { assert!(V > 0 && V <= u16::MAX as usize, "a store holds 1 to 65535 views") };
        params.check()?;
        Ok(Self { params, slots: [Slot { pose: Pose::IDENTITY, seen: 0 }; V], tick: 0 })
    }

    /// The stored view that a pose shows; `None` when it would be a new one. Changes nothing.
    #[must_use]
    pub fn find(&self, pose: &Pose) -> Option<u16> {
        let mut best: Option<(u16, f32)> = None;
        for (id, slot) in self.slots.iter().enumerate().filter(|(_, s)| s.seen > 0) {
            let (translation, rotation) = apart(&slot.pose, pose);
            if translation <= self.params.translation && rotation <= self.params.rotation {
                // How much of both allowances is used; with an allowance of 0 the quotient is NaN and counts as nothing.
                let far = (translation / self.params.translation).max(0.0) + (rotation / self.params.rotation).max(0.0);
                if best.is_none_or(|(_, b)| far < b) {
                    best = Some((id as u16, far));
                }
            }
        }
        best.map(|(id, _)| id)
    }

    /// The view of a pose, now seen: stored if it is new, in a free slot or that of the least recently seen.
    pub fn see(&mut self, pose: &Pose) -> View {
        if self.tick == u32::MAX {
            // After four thousand million captures the order starts anew.
            self.slots.iter_mut().for_each(|s| s.seen = s.seen.min(1));
            self.tick = 1;
        }
        self.tick += 1;
        let tick = self.tick;
        if let Some(id) = self.find(pose) {
            if let Some(slot) = self.slots.get_mut(usize::from(id)) {
                slot.seen = tick;
            }
            return View::Same(id);
        }
        let oldest = self.slots.iter_mut().enumerate().min_by_key(|(_, s)| s.seen);
        let Some((id, slot)) = oldest else {
            // No slots: `new` does not compile for that.
            return View::New(0);
        };
        let free = slot.seen == 0;
        *slot = Slot { pose: *pose, seen: tick };
        if free { View::New(id as u16) } else { View::Replaced(id as u16) }
    }

    /// The pose that a view was first captured from; `None` when there is no such view.
    #[must_use]
    pub fn pose(&self, id: u16) -> Option<Pose> {
        self.slots.get(usize::from(id)).filter(|s| s.seen > 0).map(|s| s.pose)
    }

    /// How many views are stored.
    #[must_use]
    pub fn len(&self) -> usize {
        self.slots.iter().filter(|s| s.seen > 0).count()
    }

    /// Whether none is.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Forgets all views.
    pub fn reset(&mut self) {
        self.slots.iter_mut().for_each(|s| s.seen = 0);
        self.tick = 0;
    }
}

/// How far two poses are apart: metres and radians.
pub(super) fn apart(a: &Pose, b: &Pose) -> (f32, f32) {
    let translation = b.translation() - a.translation();
    (translation.length(), rotation::way(a.rotation(), b.rotation()).length())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Quat, Vec3};
    use proptest::prelude::*;

    fn pose(x: f32, degrees: f32) -> Pose {
        Pose::new(Quat::from_rotation_y(degrees.to_radians()), Vec3::X * x).unwrap()
    }

    #[test]
    fn both_limits_count_and_the_nearest_wins() {
        let mut ids = ViewIds::<4>::new(ViewParams::default()).unwrap();
        assert_eq!(ids.see(&pose(0.0, 0.0)), View::New(0));
        assert_eq!(ids.see(&pose(0.0, 5.1)), View::New(1));
        assert_eq!(ids.see(&pose(0.051, 0.0)), View::New(2));
        assert_eq!(ids.find(&pose(0.03, 0.5)), Some(2), "2 cm from one, 3 from the other");
        assert_eq!(ids.find(&pose(0.02, 0.5)), Some(0));
        assert_eq!(ids.find(&pose(0.0, 3.0)), Some(1));
        assert_eq!(ids.find(&pose(0.0, -5.1)), None);
        assert_eq!((ids.len(), ids.pose(3)), (3, None));
        ids.reset();
        assert!(ids.is_empty());
    }

    #[test]
    fn a_view_does_not_creep() {
        let mut ids = ViewIds::<4>::new(ViewParams::default()).unwrap();
        let seen: std::vec::Vec<u16> = (0..=12).map(|i| ids.see(&pose(i as f32 * 0.02, 0.0)).id()).collect();
        // Each pose goes to the nearest view within 5 cm.
        assert_eq!(seen, [0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3, 0]);
    }

    #[test]
    fn exact_equality_can_be_asked_for() {
        let mut ids = ViewIds::<2>::new(ViewParams { translation: 0.0, rotation: 0.0 }).unwrap();
        assert_eq!(ids.see(&pose(0.0, 0.0)), View::New(0));
        assert_eq!(ids.see(&pose(0.0, 0.0)), View::Same(0));
        assert_eq!(ids.see(&pose(1e-6, 0.0)), View::New(1));
        for bad in [ViewParams { translation: f32::NAN, rotation: 0.0 }, ViewParams { translation: 0.0, rotation: 4.0 }]
        {
            assert!(ViewIds::<2>::new(bad).is_err());
        }
    }

    #[test]
    fn the_order_outlives_its_counter() {
        let mut ids = ViewIds::<2>::new(ViewParams::default()).unwrap();
        ids.see(&pose(0.0, 0.0));
        ids.tick = u32::MAX;
        assert_eq!(ids.see(&pose(1.0, 0.0)), View::New(1));
        assert_eq!(ids.see(&pose(2.0, 0.0)), View::Replaced(0));
    }

    proptest! {
        /// A store of the plainest kind: a list in order of last sight.
        #[test]
        fn the_least_recently_seen_goes(steps in proptest::collection::vec(0_u8..9, 1..60)) {
            let mut ids = ViewIds::<3>::new(ViewParams::default()).unwrap();
            let mut list: std::vec::Vec<(u8, u16)> = std::vec::Vec::new();
            for place in steps {
                let got = ids.see(&pose(f32::from(place), 0.0));
                if let Some(i) = list.iter().position(|(p, _)| *p == place) {
                    let entry = list.remove(i);
                    prop_assert_eq!(got, View::Same(entry.1));
                    list.push(entry);
                } else if list.len() < 3 {
                    prop_assert_eq!(got, View::New(list.len() as u16));
                    list.push((place, got.id()));
                } else {
                    let (_, id) = list.remove(0);
                    prop_assert_eq!(got, View::Replaced(id));
                    list.push((place, id));
                }
            }
        }
    }
}
