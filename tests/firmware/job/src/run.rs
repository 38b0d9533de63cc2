//! The job: decode, what changed, pyramid, normals where asked, hit tests, places, height map, path.

use isobath::glam::{Vec2, Vec3};
use isobath::ground::image::{Image, ImageViewMut};
use isobath::localized::height_map::{Grid, HeightMap, HeightMapParams};
use isobath::localized::hit::{Hit, HitParams, hit_test};
use isobath::localized::normals::NormalParams;
use isobath::localized::normals::dense::{self, Region};
use isobath::localized::placement::{PlaceParams, Placement, Spot, place};
use isobath::localized::planner::{Path, Plan, Planner, Replan, Walker};
use isobath::sensing::depth::noise::DepthNoise;
use isobath::sensing::depth::{DepthArray, DepthUnit};
use isobath::sensing::frame::DepthFrame;
use isobath::skipping::pyramid::{Cell, Pyramid};
use isobath::skipping::tiles::{TileMap, TileReport};
use isobath::wire::rvl;

use crate::answers::{self, Answers};
use crate::frame::Packed;
use crate::memory::{ASKED, H, HITS, Memory, PLACES, SIDE, Seen, W};
use crate::{Probe, Stage};

/// Pixels of a frame.
const PIXELS: u32 = (W * H) as u32;

const fn stage(name: &'static str, times: u32, unit: &'static str, budgeted: bool) -> Stage {
    Stage { name, times, unit, budgeted }
}

/// The stages, in the order of the work. The budgeted ones are what the localized job's budget names; every stage is in the sum of
/// the whole frame.
pub const STAGES: [Stage; 8] = [
    stage("decode", PIXELS, "pixel", false),
    stage("tiles", PIXELS, "pixel", false),
    stage("pyramid", PIXELS, "pixel", true),
    stage("normals-asked", (ASKED.0 * ASKED.1) as u32, "pixel", false),
    stage("hits", HITS as u32, "hit", true),
    stage("places", PLACES as u32, "place", true),
    stage("map", PIXELS, "pixel", false),
    stage("replan", 1, "plan", true),
];

/// The core refused what it was given: a stream that does not decode, a camera that can't be. On the device: skip the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Refused;

/// The job, with its memory borrowed for good and what it knows from earlier frames.
#[derive(Debug)]
pub struct Job<'m> {
    depth: &'m mut DepthArray<W, H>,
    tiles: TileMap<'m>,
    pyramid: &'m mut [Cell<u16>],
    scratch: &'m mut [f32],
    normals: &'m mut [Image<f32, { ASKED.0 }, { ASKED.1 }>; 3],
    hits: &'m mut [Seen; HITS],
    places: &'m mut [Option<Placement>; PLACES],
    map: HeightMap<'m>,
    planner: Planner<'m>,
    points: &'m mut [Vec3],
    path: Option<Path>,
}

impl<'m> Job<'m> {
    /// Takes the memory; the height map's middle lies at `centre` (world, metres), y up.
    ///
    /// # Errors
    /// [`Refused`] for a centre that is not finite.
    pub fn new(memory: &'m mut Memory, centre: Vec3) -> Result<Self, Refused> {
        let Memory { depth, reference, tiles, pyramid, scratch, normals, hits, places, cells, nodes, path } = memory;
        let grid = Grid::new(centre, Vec3::Y, Vec3::NEG_Z, 0.05, SIDE, SIDE).map_err(|_| Refused)?;
        Ok(Self {
            depth,
            tiles: TileMap::new(reference.view_mut(), tiles).map_err(|_| Refused)?,
            pyramid,
            scratch,
            normals,
            hits,
            places,
            map: HeightMap::new(grid, cells, HeightMapParams::DEFAULT).map_err(|_| Refused)?,
            planner: Planner::new(nodes),
            points: path,
            path: None,
        })
    }

    /// One frame through everything; the answers go to `out`, outside the measured stages.
    ///
    /// # Errors
    /// [`Refused`] when the stream or the camera is none.
    pub fn frame(
        &mut self,
        packed: &Packed<'_>,
        probe: &mut impl Probe,
        out: &mut impl Answers,
    ) -> Result<(), Refused> {
        let [decode, tiles, pyramid, asked, hits, places, map, replan] = STAGES;
        let used = probe.stage(decode, || rvl::decode(packed.depth, &mut self.depth.view_mut()));
        out.count("bytes", used.map_err(|_| Refused)?);
        let (camera, pose) = packed.view.read().ok_or(Refused)?;
        let frame = DepthFrame::new(self.depth.view(), DepthUnit::MILLIMETRE, camera).with_pose(pose);

        let report: TileReport = probe.stage(tiles, || self.tiles.update(&frame, &DepthNoise::KINECT));
        out.count("tiles changed", report.changed as usize);
        out.count("tiles unchanged", report.unchanged as usize);

        let pyramid = probe.stage(pyramid, || Pyramid::build(frame.depth(), self.pyramid)).map_err(|_| Refused)?;
        out.count("holes", pyramid.whole().holes.into());

        let part = Region { x: (W - ASKED.0) / 2, y: (H - ASKED.1) / 2, width: ASKED.0, height: ASKED.1 };
        probe.stage(asked, || normals_of(&frame, part, self.scratch, self.normals)).ok_or(Refused)?;
        answers::normals(self.normals, out);

        probe.stage(hits, || {
            for (i, seen) in self.hits.iter_mut().enumerate() {
                // Ten by ten over the image, between pixel centres.
                let at = Vec2::new((i % 10) as f32 * 16.0 + 8.3, (i / 10) as f32 * 12.0 + 6.4);
                *seen = hit_test(&frame, at, &HitParams::default()).hit().map_or(Seen::NOTHING, kept);
            }
        });
        answers::hits(self.hits, out);

        probe.stage(places, || {
            let wanted = PlaceParams { max_hidden: 0.02, ..PlaceParams::new(Vec3::splat(0.3), Vec3::Y) };
            for (i, spot) in self.places.iter_mut().enumerate() {
                let at = Spot::Pixel(i % 5 * 28 + 24, i / 5 * 14 + 60);
                *spot = place(&frame, Some(&pyramid), at, &wanted).outcome.ok();
            }
        });
        answers::places(self.places, out);

        let integrated = probe.stage(map, || self.map.integrate(&frame));
        out.count("readings in the map", integrated.used as usize);

        let (from, to) = (self.map.grid().point_of(14, 25, 0.0), self.map.grid().point_of(50, 44, 0.0));
        let plan = probe.stage(replan, || self.replan(from, to));
        answers::plan(&plan, self.points, out);
        self.path = match plan {
            Plan::Found(path) => Some(path),
            _ => None,
        };
        Ok(())
    }

    /// The old path where it still holds, else a new one.
    fn replan(&mut self, from: Vec3, to: Vec3) -> Plan {
        let walker = Walker { radius: 0.1, ..Walker::DEFAULT };
        let planned = match self.path {
            Some(old) => match self.planner.replan(&self.map, &walker, from, to, &old, self.points) {
                Ok(Replan::Kept) => Ok(Plan::Found(old)),
                Ok(Replan::Planned(plan)) => Ok(plan),
                Err(error) => Err(error),
            },
            None => self.planner.plan(&self.map, &walker, from, to, self.points),
        };
        // The walker is a constant in range: there is no error.
        planned.unwrap_or(Plan::NoPath { expanded: 0 })
    }
}

fn kept(hit: &Hit) -> Seen {
    Seen { point: hit.point, normal: hit.normal.unwrap_or(Vec3::ZERO), sigma: hit.sigma_z }
}

/// Normals of a part of the image, into planes of the part's size.
fn normals_of(
    frame: &DepthFrame<'_>,
    part: Region,
    scratch: &mut [f32],
    [x, y, z]: &mut [Image<f32, { ASKED.0 }, { ASKED.1 }>; 3],
) -> Option<()> {
    let mut planes = [x.view_mut(), y.view_mut(), z.view_mut()];
    dense::region(frame, &NormalParams::default(), part, scratch, |row, n| {
        let fill = |plane: &mut ImageViewMut<'_, f32>, values: &[f32]| {
            for (cell, value) in plane.row_mut(row - part.y).iter_mut().zip(values) {
                *cell = *value;
            }
        };
        let [x, y, z] = &mut planes;
        fill(x, n.x);
        fill(y, n.y);
        fill(z, n.z);
    })
    .ok()
    .map(|_| ())
}
