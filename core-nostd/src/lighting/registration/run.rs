//! The course of a registration, one row of cells at a time.
//!
//! *Overlap*: which views see the same? *Align*: one view after the other against those that stand, on every few cells. *Refine*: all
//! views against all others, on all cells, solved together.

use glam::{Quat, Vec3};
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use super::associate::{Cells, Gates, Sums, add_row};
use super::cells::Grid;
use super::solve::{Known, Scale, into_camera, prior, symmetric};
use super::{Direction, FIELDS, Outcome, RegistrationParams, Slot, ViewReport};
use crate::ground::math;
use crate::ground::rotation::{self, rotate};
use crate::sensing::camera::Pose;

/// Most cells of a view that take part in the overlap pass and the first level, the second, and the refinement.
const LEVELS: [usize; 3] = [400, 1600, 4096];
/// Corrections below this end a level, metres of the view's points.
const SMALL: [f64; 3] = [3e-3, 5e-4, 1e-4];
/// Passes after which a level ends anyway.
const PASSES: [u16; 3] = [60, 20, 15];
/// Matched cells without which two views have nothing in common.
const COMMON: u32 = 24;
/// A step below this many scales has settled.
const SETTLED: f64 = 0.1;
/// Scale at which a view leaves the first level, metres.
const FIRST_SCALE: f32 = 0.01;
/// Smallest scale of misalignment, metres.
const LEAST_SCALE: f32 = 1.5e-3;
/// Directions known no better than this many times what noisy normals feign are not known.
const FEIGNED: f64 = 1.5;
/// What a solve is counted as, cells.
const SOLVE: usize = 500;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Idle,
    Overlap,
    Align { view: usize, level: usize },
    Refine,
    Done,
}

/// Where a pass is: pair and row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Cursor {
    source: usize,
    target: usize,
    row: usize,
}

/// What one view's cells say in a pass, and what it came to.
#[derive(Debug, Clone, Copy)]
struct View {
    /// Camera to the reference view's camera.
    now: Pose,
    start: Pose,
    fixed: bool,
    /// It stands: fixed, or aligned.
    stands: bool,
    /// The views that stood when it was aligned told too little: it waits until no other is left.
    waits: bool,
    outcome: Outcome,
    iterations: u16,
    known: Known,
    /// What the views tell that are known themselves, where some are not.
    firm: Option<Known>,
    scale: Scale,
    // Of the pass.
    weight: f64,
    spread: f64,
    squares: f64,
    matched: u32,
    inliers: u32,
    right: Vector6<f64>,
}

impl View {
    const EMPTY: Self = Self {
        now: Pose::IDENTITY,
        start: Pose::IDENTITY,
        fixed: false,
        stands: false,
        waits: false,
        outcome: Outcome::Working,
        iterations: 0,
        known: Known::NOTHING,
        firm: None,
        scale: Scale { centre: ZERO3, radius: 1.0 },
        weight: 0.0,
        spread: 0.0,
        squares: 0.0,
        matched: 0,
        inliers: 0,
        right: ZERO6,
    };

    fn clear(&mut self) {
        (self.weight, self.spread, self.squares) = (0.0, 0.0, 0.0);
        (self.matched, self.inliers) = (0, 0);
        self.right = ZERO6;
    }

    fn add(&mut self, sums: &Sums) {
        self.weight += sums.weight;
        self.spread += sums.spread;
        self.squares += sums.squares;
        self.matched = self.matched.saturating_add(sums.matched);
        self.inliers = self.inliers.saturating_add(sums.inliers);
    }

    fn decompose(&mut self, information: &Matrix6<f64>, prior: &Matrix6<f64>, slot: &Slot, least: f32) {
        self.scale = scale(slot, &self.now);
        self.firm = None;
        let feigned = if self.weight > 0.0 { FEIGNED * self.spread / self.weight } else { 0.0 };
        self.known = Known::of(information, prior, &self.scale, self.weight, feigned + f64::from(least));
    }

    /// What is believed of the correction, and the correction so far, as (rotation, translation of the origin).
    fn belief(&self, params: &RegistrationParams) -> (Matrix6<f64>, Vector6<f64>) {
        let (turn, shift) = (0.5 * f64::from(params.max_turn), 0.5 * f64::from(params.max_shift));
        if !(turn > 1e-6 && shift > 1e-6) {
            return (ZERO66, ZERO6);
        }
        let at = vector(self.now.translation());
        let turned = vector(rotation::way(self.start.rotation(), self.now.rotation()));
        let moved = at - vector(self.start.translation()) - turned.cross(&at);
        (prior(&at, turn, shift), Vector6::new(turned.x, turned.y, turned.z, moved.x, moved.y, moved.z))
    }

    /// Draws it back to where it was tracked, weakly: while residuals are coarse, what little they know of some directions must
    /// not throw it out of the others' sight. Gives the information of that belief.
    fn believe(&mut self, params: &RegistrationParams) -> Matrix6<f64> {
        let (prior, moved) = self.belief(params);
        self.right -= prior * moved;
        prior
    }

    /// Takes back what was corrected along directions that are not known, as far as the camera is concerned: where every pose
    /// fits as well, the tracker's position and turn are the best.
    fn take_back(&mut self, params: &RegistrationParams) -> f64 {
        if self.known.unknown == 0 || self.known.unknown == 6 {
            return 0.0;
        }
        let (prior, moved) = self.belief(params);
        let step = self.known.least(&moved, &prior);
        self.apply(&step)
    }

    /// Moves it; how far its points went, metres.
    fn apply(&mut self, step: &Vector6<f64>) -> f64 {
        let turn = Vector3::new(step[0], step[1], step[2]);
        let shift = Vector3::new(step[3], step[4], step[5]) + turn.cross(&self.scale.centre);
        let length = shift.norm() + turn.norm() * self.scale.radius;
        // A step of more than half a turn or many metres is no correction; NaN fails too.
        if !(length < 1e3) {
            return f64::INFINITY;
        }
        let centre = vec3(&self.scale.centre);
        let turn = vec3(&turn);
        let turned = rotation::turned(self.now.rotation(), turn);
        let arm = rotate(rotation::turned(Quat::IDENTITY, turn), self.now.translation() - centre);
        self.now = Pose::new(turned, centre + vec3(&shift) + arm).unwrap_or(self.now);
        length
    }

    const fn is_moving(&self) -> bool {
        self.stands && !self.fixed
    }

    /// What is known of it, alone or beside others.
    fn knowledge(&self) -> &Known {
        self.firm.as_ref().unwrap_or(&self.known)
    }

    fn share(&self) -> f32 {
        self.inliers as f32 / (self.matched.max(1)) as f32
    }

    fn reject(&mut self, why: Outcome) {
        self.now = self.start;
        self.stands = false;
        self.outcome = why;
    }
}

const ZERO3: Vector3<f64> = Vector3::from_array_storage(nalgebra::ArrayStorage([[0.0; 3]; 1]));
const ZERO6: Vector6<f64> = Vector6::from_array_storage(nalgebra::ArrayStorage([[0.0; 6]; 1]));
const ZERO66: Matrix6<f64> = Matrix6::from_array_storage(nalgebra::ArrayStorage([[0.0; 6]; 6]));

fn vec3(v: &Vector3<f64>) -> Vec3 {
    Vec3::new(v.x as f32, v.y as f32, v.z as f32)
}

fn vector(v: Vec3) -> Vector3<f64> {
    Vector3::new(f64::from(v.x), f64::from(v.y), f64::from(v.z))
}

/// Middle and radius of a view's points, in the reference's frame.
fn scale(slot: &Slot, pose: &Pose) -> Scale {
    let n = slot.extent.count.max(1) as f32;
    let middle = slot.extent.first / n;
    let variance = slot.extent.second / n - middle.length_squared();
    Scale { centre: vector(pose.to_world(middle)), radius: f64::from(math::sqrt(variance.max(1e-6))) }
}

/// Every how many-eth cell keeps a view at most so large, each way.
fn stride(grid: &Grid, most: usize) -> usize {
    let mut stride = 1;
    while stride < 64 && grid.cells() > most.saturating_mul(stride * stride) {
        stride *= 2;
    }
    stride
}

#[derive(Debug)]
pub(super) struct Run<const N: usize> {
    stage: Stage,
    cursor: Cursor,
    /// Passes in this level.
    pass: u16,
    gates: Gates,
    sums: Sums,
    reference: Pose,
    views: [View; N],
    /// Views that are ready, in the order in which they came to stand.
    order: [usize; N],
    standing: usize,
    /// Matched cells of source and target, coarsely.
    overlap: [[u32; N]; N],
    histogram: Sums,
    matrix: [[Matrix6<f64>; N]; N],
}

impl<const N: usize> Run<N> {
    pub(super) const IDLE: Self = Self {
        stage: Stage::Idle,
        cursor: Cursor { source: 0, target: 0, row: 0 },
        pass: 0,
        gates: Gates { distance: 0.0, cosine: 1.0, scale: 0.0 },
        sums: Sums::ZERO,
        reference: Pose::IDENTITY,
        views: [View::EMPTY; N],
        order: [0; N],
        standing: 0,
        overlap: [[0; N]; N],
        histogram: Sums::ZERO,
        matrix: [[ZERO66; N]; N],
    };

    /// Ends it without result.
    pub(super) fn stop(&mut self) {
        self.stage = Stage::Idle;
    }

    /// Begins anew, in place: a copy of all this would be large on a small stack. `false` when no view that is ready is fixed.
    pub(super) fn begin(&mut self, slots: &[Slot; N], params: &RegistrationParams, fixed: &[usize]) -> bool {
        self.stop();
        let mut ready = fixed.iter().filter_map(|&i| slots.get(i).filter(|s| s.is_ready()));
        let Some(first) = ready.next() else { return false };
        self.reference = first.tracked;
        self.standing = 0;
        self.pass = 0;
        self.overlap.as_flattened_mut().fill(0);
        for (i, (view, slot)) in self.views.iter_mut().zip(slots).enumerate() {
            *view = View::EMPTY;
            view.start = slot.tracked.relative_to(&self.reference);
            view.now = view.start;
            view.fixed = slot.is_ready() && fixed.contains(&i);
            view.stands = view.fixed;
            if view.fixed {
                view.outcome = Outcome::Fixed;
                if let Some(place) = self.order.get_mut(self.standing) {
                    *place = i;
                    self.standing += 1;
                }
            }
            view.scale = scale(slot, &view.now);
        }
        self.stage = Stage::Overlap;
        self.gates = widest(params);
        self.begin_pass(slots);
        true
    }

    pub(super) const fn is_done(&self) -> bool {
        matches!(self.stage, Stage::Idle | Stage::Done)
    }

    /// Whether this pass compares these two.
    fn wants(&self, slots: &[Slot; N], source: usize, target: usize) -> bool {
        let (Some(s), Some(t)) = (self.views.get(source), self.views.get(target)) else { return false };
        let ready = |i: usize| slots.get(i).is_some_and(Slot::is_ready);
        let common = self.overlap.get(source).and_then(|o| o.get(target)).is_some_and(|&n| n >= COMMON);
        source != target
            && ready(source)
            && ready(target)
            && match self.stage {
                Stage::Overlap => !(s.fixed && t.fixed),
                Stage::Align { view, .. } => source == view && t.stands && common,
                Stage::Refine => s.stands && t.stands && !(s.fixed && t.fixed) && common,
                Stage::Idle | Stage::Done => false,
            }
    }

    /// The first pair of this pass at or after the cursor's; `false` when there is none.
    fn seek(&mut self, slots: &[Slot; N]) -> bool {
        while self.cursor.source < N {
            while self.cursor.target < N {
                if self.wants(slots, self.cursor.source, self.cursor.target) {
                    return true;
                }
                self.cursor.target += 1;
            }
            self.cursor.source += 1;
            self.cursor.target = 0;
        }
        false
    }

    fn begin_pass(&mut self, slots: &[Slot; N]) {
        self.sums = Sums::ZERO;
        self.histogram = Sums::ZERO;
        self.views.iter_mut().for_each(View::clear);
        self.matrix.as_flattened_mut().fill(ZERO66);
        self.cursor = Cursor { source: 0, target: 0, row: 0 };
        self.seek(slots);
        self.cursor.row = self.first_row(slots);
    }

    fn stride(&self, slots: &[Slot; N]) -> usize {
        let level = match self.stage {
            Stage::Align { level, .. } => level,
            Stage::Refine => 2,
            _ => 0,
        };
        let most = LEVELS.get(level).copied().unwrap_or(400);
        slots.get(self.cursor.source).map_or(1, |s| stride(&s.grid, most))
    }

    fn first_row(&self, slots: &[Slot; N]) -> usize {
        self.stride(slots) / 2
    }

    /// Does one row of cells, or what is to do between passes; how much work that was, in cells.
    pub(super) fn unit(
        &mut self,
        slots: &[Slot; N],
        memory: &[f32],
        share: usize,
        params: &RegistrationParams,
    ) -> usize {
        let Cursor { source, target, row } = self.cursor;
        let (Some(from), Some(to)) = (slots.get(source), slots.get(target)) else {
            self.close_pass(slots, params);
            return SOLVE;
        };
        let stride = self.stride(slots).max(1);
        if row >= from.grid.rows {
            self.close_pair();
            self.cursor.target += 1;
            self.seek(slots);
            self.cursor.row = self.first_row(slots);
            return 1;
        }
        let (Some(s), Some(t)) = (self.views.get(source), self.views.get(target)) else { return 1 };
        let motion = s.now.relative_to(&t.now);
        add_row(
            cells(from, source, memory, share),
            cells(to, target, memory, share),
            motion.rotation(),
            motion.translation(),
            row,
            stride,
            &self.gates,
            &mut self.sums,
        );
        self.cursor.row += stride;
        from.grid.columns / stride + 1
    }

    /// Adds a pair's sums to the system.
    fn close_pair(&mut self) {
        let Cursor { source, target, .. } = self.cursor;
        let sums = core::mem::replace(&mut self.sums, Sums::ZERO);
        if let Some(n) = self.overlap.get_mut(source).and_then(|o| o.get_mut(target))
            && self.stage == Stage::Overlap
        {
            *n = sums.matched;
            return;
        }
        let Some(there) = self.views.get(target).map(|v| v.now) else { return };
        let turn = [Vec3::X, Vec3::Y, Vec3::Z].map(|e| vector(rotate(there.rotation(), e)));
        let map = into_camera(&Matrix3::from_columns(&turn), &vector(there.translation()));
        let h = map.tr_mul(&symmetric(&sums.h)) * map;
        let g = map.tr_mul(&Vector6::from_column_slice(&sums.g));
        for (a, b, sign) in
            [(source, source, 1.0), (target, target, 1.0), (source, target, -1.0), (target, source, -1.0)]
        {
            if let Some(m) = self.matrix.get_mut(a).and_then(|row| row.get_mut(b)) {
                *m += h * sign;
            }
        }
        for (i, sign) in [(source, -1.0), (target, 1.0)] {
            if let Some(view) = self.views.get_mut(i) {
                view.add(&sums);
                view.right += g * sign;
            }
        }
        self.histogram.matched = self.histogram.matched.saturating_add(sums.matched);
        for (all, n) in self.histogram.histogram.iter_mut().zip(sums.histogram) {
            *all = all.saturating_add(n);
        }
    }

    fn close_pass(&mut self, slots: &[Slot; N], params: &RegistrationParams) {
        match self.stage {
            Stage::Overlap => self.choose(slots, params),
            Stage::Align { view, level } => self.close_align(slots, params, view, level),
            Stage::Refine => self.close_refine(slots, params),
            Stage::Idle | Stage::Done => return,
        }
        // The last pass's sums are what the report tells.
        if self.stage != Stage::Done {
            self.begin_pass(slots);
        }
    }

    /// Once the views have moved as far as this scale asks for, the next is what the residuals say, at least half of it: a
    /// floor that fills most of the view agrees long before the furniture does, and must not make outliers of it.
    fn narrow(&mut self, moved: f64) {
        if moved < SETTLED * f64::from(self.gates.scale) {
            let said = self.histogram.deviation();
            self.gates.scale = (self.gates.scale * math::clamp(said, 0.5, 1.0)).max(LEAST_SCALE);
        }
    }

    /// Takes up the view with most in common with those that stand; when none is left, refines.
    fn choose(&mut self, slots: &[Slot; N], params: &RegistrationParams) {
        let mut best = None;
        for (i, view) in self.views.iter().enumerate() {
            if view.stands || view.outcome != Outcome::Working || !slots.get(i).is_some_and(Slot::is_ready) {
                continue;
            }
            let row = self.overlap.get(i).into_iter().flatten();
            let usable = row.zip(&self.views).filter(|(n, v)| v.stands && **n >= COMMON).map(|(n, _)| *n);
            let common = usable.fold(0, u32::saturating_add);
            // Those that wait come last.
            let rank = (!view.waits, common);
            if common > 0 && best.is_none_or(|(_, most)| rank > most) {
                best = Some((i, rank));
            }
        }
        self.pass = 0;
        self.stage = match best {
            Some((view, _)) => {
                self.gates = widest(params);
                Stage::Align { view, level: 0 }
            }
            None => {
                for (view, slot) in self.views.iter_mut().zip(slots) {
                    if view.outcome == Outcome::Working && !view.stands && slot.is_ready() {
                        view.outcome = Outcome::NoOverlap;
                    }
                }
                if self.views.iter().any(View::is_moving) { Stage::Refine } else { Stage::Done }
            }
        };
    }

    fn close_align(&mut self, slots: &[Slot; N], params: &RegistrationParams, view: usize, level: usize) {
        self.pass += 1;
        let information = self.matrix.get(view).and_then(|row| row.get(view)).copied().unwrap_or(ZERO66);
        let (Some(v), Some(slot)) = (self.views.get_mut(view), slots.get(view)) else { return };
        // On the way, weak directions may be weaker than they will be: the belief holds them, and what stays unknown is taken back.
        let prior = v.believe(params);
        v.decompose(&information, &prior, slot, 0.0);
        let moved = v.apply(&(v.known.inverse * v.right)) + v.take_back(params);
        v.iterations = v.iterations.saturating_add(1);
        let lost = v.matched < COMMON || !moved.is_finite();
        self.narrow(moved);
        let scale = self.gates.scale;
        let Some(v) = self.views.get_mut(view) else { return };
        let small = SMALL.get(level).is_none_or(|s| moved < *s) && (level > 0 || scale <= FIRST_SCALE);
        let last = PASSES.get(level).is_none_or(|n| self.pass >= *n);
        if lost && !v.waits {
            v.waits = true;
            v.now = v.start;
        } else if lost {
            v.reject(Outcome::NoOverlap);
        } else if level == 0 && (small || last) {
            self.pass = 0;
            self.stage = Stage::Align { view, level: 1 };
            return;
        } else if small || last {
            if v.known.values.iter().any(|i| *i < f64::from(params.min_information)) && !v.waits {
                v.waits = true;
                v.now = v.start;
            } else if v.share() < params.min_inliers {
                v.reject(Outcome::Poor);
            } else {
                v.stands = true;
                if let Some(place) = self.order.get_mut(self.standing) {
                    *place = view;
                    self.standing += 1;
                }
            }
        } else {
            return;
        }
        self.choose(slots, params);
    }

    fn close_refine(&mut self, slots: &[Slot; N], params: &RegistrationParams) {
        self.pass += 1;
        let moved = self.solve(slots, params);
        self.narrow(moved);
        let small = SMALL.get(2).is_none_or(|s| moved < *s);
        if !(small || PASSES.get(2).is_none_or(|n| self.pass >= *n)) {
            return;
        }
        for view in self.views.iter_mut().filter(|v| v.is_moving()) {
            let turn = rotation::way(view.start.rotation(), view.now.rotation()).length();
            let shift = (view.now.translation() - view.start.translation()).length();
            if !(turn <= params.max_turn && shift <= params.max_shift) {
                view.reject(Outcome::TooFar);
            } else if view.share() < params.min_inliers {
                view.reject(Outcome::Poor);
            } else {
                view.outcome = match (view.knowledge().unknown, small) {
                    (0, true) => Outcome::Registered,
                    (0, false) => Outcome::NotConverged,
                    (_, _) => Outcome::Degenerate,
                };
            }
        }
        self.stage = Stage::Done;
    }

    /// Solves for all views that stand and are not fixed, and moves them; the farthest any went, metres.
    ///
    /// The matrix is symmetric: of two views, the block in the later one's row is worked on, that in the earlier one's stays as it was.
    fn solve(&mut self, slots: &[Slot; N], params: &RegistrationParams) -> f64 {
        let order = self.order;
        // Last to first: each pivot, and what it leaves to those before it.
        for (k, &view) in order.iter().enumerate().take(self.standing).rev() {
            if !self.is_moving(view) {
                continue;
            }
            let pivot = self.block(view, view);
            let (Some(v), Some(slot)) = (self.views.get_mut(view), slots.get(view)) else { continue };
            v.decompose(&pivot, &ZERO66, slot, params.min_information);
            let (inverse, right) = (v.known.inverse, v.right);
            for (i, &a) in order.iter().enumerate().take(k) {
                if !self.is_moving(a) {
                    continue;
                }
                let towards = self.block(view, a).tr_mul(&inverse);
                for &b in order.iter().take(i + 1).filter(|&&b| self.views.get(b).is_some_and(View::is_moving)) {
                    let less = towards * self.block(view, b);
                    if let Some(m) = self.matrix.get_mut(a).and_then(|row| row.get_mut(b)) {
                        *m -= less;
                    }
                }
                if let Some(v) = self.views.get_mut(a) {
                    v.right -= towards * right;
                }
            }
        }
        self.find_firm(slots, params);
        // First to last.
        let mut steps = [ZERO6; N];
        let mut farthest = 0.0_f64;
        for (k, &view) in order.iter().enumerate().take(self.standing) {
            if !self.is_moving(view) {
                continue;
            }
            let mut right = self.views.get(view).map_or(ZERO6, |v| v.right);
            for (&a, step) in order.iter().zip(&steps).take(k) {
                if self.is_moving(a) {
                    right -= self.block(view, a) * step;
                }
            }
            let Some(v) = self.views.get_mut(view) else { continue };
            let step = v.known.inverse * right;
            farthest = farthest.max(v.apply(&step) + v.take_back(params));
            v.iterations = v.iterations.saturating_add(1);
            if let Some(place) = steps.get_mut(k) {
                *place = step;
            }
        }
        farthest
    }

    /// A view that is well known beside another, of which itself little is known, is not well known: says of each view what the views
    /// tell that are (fixed, or known by these).
    fn find_firm(&mut self, slots: &[Slot; N], params: &RegistrationParams) {
        if self.views.iter().all(|v| !v.is_moving() || v.known.unknown == 0) {
            return;
        }
        let order = self.order;
        let mut firm = [false; N];
        for (place, view) in firm.iter_mut().zip(&self.views) {
            *place = view.fixed;
        }
        // Each round makes at least one firm, or is the last.
        for _ in 0..N {
            let mut more = false;
            for (k, &view) in order.iter().enumerate().take(self.standing) {
                if !self.is_moving(view) || firm.get(view).is_none_or(|f| *f) {
                    continue;
                }
                let mut information = ZERO66;
                for (i, &other) in order.iter().enumerate().take(self.standing) {
                    if i != k && firm.get(other).is_some_and(|f| *f) {
                        information -= if i < k { self.block(other, view) } else { self.block(view, other) };
                    }
                }
                let (Some(v), Some(slot)) = (self.views.get(view), slots.get(view)) else { continue };
                let mut v = *v;
                v.decompose(&information, &ZERO66, slot, params.min_information);
                if let (Some(kept), Some(f)) = (self.views.get_mut(view), firm.get_mut(view)) {
                    *f = v.known.unknown == 0;
                    more |= *f;
                    kept.firm = Some(v.known);
                }
            }
            if !more {
                break;
            }
        }
    }

    fn is_moving(&self, view: usize) -> bool {
        self.views.get(view).is_some_and(View::is_moving)
    }

    fn block(&self, row: usize, column: usize) -> Matrix6<f64> {
        self.matrix.get(row).and_then(|r| r.get(column)).copied().unwrap_or(ZERO66)
    }

    pub(super) fn report(&self, slot: usize, place: &Slot) -> Option<ViewReport> {
        let view = self.views.get(slot).filter(|_| self.stage != Stage::Idle && place.is_ready())?;
        let pose = if view.now == view.start { place.tracked } else { self.reference.compose(&view.now) };
        let done = self.stage == Stage::Done;
        let mut directions = [Direction { turn: Vec3::ZERO, shift: Vec3::ZERO, information: 0.0 }; 6];
        for (d, (way, value)) in
            directions.iter_mut().zip(view.knowledge().directions.iter().zip(view.knowledge().values))
        {
            d.turn = self.reference.direction_to_world(Vec3::new(way[0] as f32, way[1] as f32, way[2] as f32));
            d.shift = self.reference.direction_to_world(Vec3::new(way[3] as f32, way[4] as f32, way[5] as f32));
            d.information = value as f32;
        }
        Some(ViewReport {
            pose,
            tracked: place.tracked,
            outcome: if done || view.fixed { view.outcome } else { Outcome::Working },
            iterations: view.iterations,
            rms: math::sqrt((view.squares / f64::from(view.inliers.max(1))) as f32),
            inliers: view.share(),
            matched: view.matched,
            centre: self.reference.to_world(vec3(&view.scale.centre)),
            directions,
            unknown: view.knowledge().unknown,
        })
    }
}

/// The gates a view begins with.
fn widest(params: &RegistrationParams) -> Gates {
    Gates {
        distance: params.max_distance,
        cosine: math::cos(math::clamp(params.max_angle, 0.0, core::f32::consts::FRAC_PI_2)),
        scale: 0.25 * params.max_distance,
    }
}

/// A slot's cells.
fn cells<'a>(slot: &'a Slot, index: usize, memory: &'a [f32], share: usize) -> Cells<'a> {
    let n = slot.grid.cells();
    let all = memory.get(index.saturating_mul(share)..).and_then(|m| m.get(..FIELDS * n)).unwrap_or(&[]);
    let (nx, rest) = all.split_at_checked(n).unwrap_or_default();
    let (ny, nz) = rest.split_at_checked(n).unwrap_or_default();
    Cells { grid: &slot.grid, nx, ny, nz }
}
