//! World shapes drawn through the frame's camera, with what the real scene hides drawn dashed.
//!
//! A line is walked in small steps; each step is in front of the measured surface, behind it, or out of view. Steps of one
//! kind in a row become one stroke.

use std::fmt::Write as _;

use isobath::glam::{Vec2, Vec3};
use isobath::ground::geometry::OrientedBox;
use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;

use super::svg::Svg;

/// Nearer than this (metres) nothing is drawn: the picture of it would be endless.
const NEAR: f32 = 0.05;

/// A line this much (metres, and as a share of depth) behind the surface still counts as lying on it.
const SLACK: (f32, f32) = (0.02, 0.01);

/// Which of a box's corners are its base, around.
const BASE: [usize; 4] = [0, 1, 5, 4];

#[derive(Clone, Copy, PartialEq, Eq)]
enum Seen {
    InFront,
    Behind,
    NotAtAll,
}

/// Draws over a picture of one frame's depth size.
#[derive(Debug)]
pub(crate) struct Pen<'a, D: DepthSample> {
    frame: &'a DepthFrame<'a, D>,
}

impl<'a, D: DepthSample> Pen<'a, D> {
    pub(crate) const fn new(frame: &'a DepthFrame<'a, D>) -> Self {
        Self { frame }
    }

    /// Where a world point appears, whether inside the image or not.
    pub(crate) fn pixel(&self, world: Vec3) -> Option<[f32; 2]> {
        let camera = self.frame.pose_or_identity().to_camera(world);
        if camera.z < NEAR {
            return None;
        }
        self.frame.intrinsics().project(camera).map(|p: Vec2| p.to_array())
    }

    fn look(&self, world: Vec3) -> (Seen, [f32; 2]) {
        let camera = self.frame.pose_or_identity().to_camera(world);
        let Some(at) = self.pixel(world) else { return (Seen::NotAtAll, [0.0; 2]) };
        let z = self.frame.pixel_of(camera).map_or(0.0, |(x, y)| self.frame.z(x, y));
        // A hole hides nothing as far as anyone knows.
        let hidden = z > 0.0 && camera.z > z + SLACK.0 + SLACK.1 * z;
        (if hidden { Seen::Behind } else { Seen::InFront }, at)
    }

    /// A straight world line: full where visible, dashed and faint where the scene hides it.
    pub(crate) fn line(&self, svg: &mut Svg, a: Vec3, b: Vec3, colour: &str, width: f32) {
        self.polyline(svg, &[a, b], colour, width);
    }

    /// A world polyline, as [`Self::line`].
    pub(crate) fn polyline(&self, svg: &mut Svg, points: &[Vec3], colour: &str, width: f32) {
        let mut stroke: Vec<[f32; 2]> = Vec::new();
        let mut kind = Seen::NotAtAll;
        let mut flush = |stroke: &mut Vec<[f32; 2]>, kind: Seen| {
            let dashed = "stroke-dasharray=\"3 4\" opacity=\"0.55\"";
            match kind {
                Seen::InFront => svg.polyline(stroke, colour, width, ""),
                Seen::Behind => svg.polyline(stroke, colour, width * 0.8, dashed),
                Seen::NotAtAll => {}
            }
            stroke.clear();
        };
        for pair in points.windows(2) {
            let [a, b] = [pair[0], pair[1]];
            let length = match (self.pixel(a), self.pixel(b)) {
                (Some(p), Some(q)) => Vec2::from(p).distance(Vec2::from(q)).min(4000.0),
                _ => 400.0,
            };
            let steps = (length / 2.0).ceil().max(1.0) as usize;
            for i in 0..=steps {
                let (seen, at) = self.look(a.lerp(b, i as f32 / steps as f32));
                if seen != kind {
                    // Join the strokes, so that no gap opens where the kind changes.
                    if seen != Seen::NotAtAll && kind != Seen::NotAtAll {
                        stroke.push(at);
                    }
                    flush(&mut stroke, kind);
                    kind = seen;
                }
                if seen != Seen::NotAtAll {
                    stroke.push(at);
                }
            }
        }
        flush(&mut stroke, kind);
    }

    /// The twelve edges of a box whose y axis points up, and its footprint filled faintly.
    pub(crate) fn cuboid(&self, svg: &mut Svg, b: &OrientedBox, colour: &str, width: f32) {
        let c = b.corners();
        self.fill(svg, &BASE.map(|i| c[i]), colour, 0.28);
        for i in 0..8_usize {
            for bit in [1, 2, 4] {
                if i & bit == 0 {
                    self.line(svg, c[i], c[i | bit], colour, width);
                }
            }
        }
    }

    /// The footprint of a box whose y axis points up: filled faintly, with its outline.
    pub(crate) fn footprint(&self, svg: &mut Svg, b: &OrientedBox, colour: &str, width: f32) {
        let c = b.corners();
        let base = BASE.map(|i| c[i]);
        self.fill(svg, &base, colour, 0.14);
        for i in 0..4 {
            self.line(svg, base[i], base[(i + 1) % 4], colour, width);
        }
    }

    /// Fills a world rectangle where the camera sees it: in small tiles, each seen or not.
    fn fill(&self, svg: &mut Svg, corners: &[Vec3; 4], colour: &str, opacity: f32) {
        const TILES: u8 = 14;
        let [a, b, c, d] = *corners;
        let at = |i: u8, j: u8| {
            let (s, t) = (f32::from(i) / f32::from(TILES), f32::from(j) / f32::from(TILES));
            a.lerp(b, s).lerp(d.lerp(c, s), t)
        };
        let mut path = String::new();
        for (i, j) in (0..TILES).flat_map(|i| (0..TILES).map(move |j| (i, j))) {
            let tile = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            let middle = (tile[0] + tile[2]) / 2.0;
            if self.look(middle).0 != Seen::InFront {
                continue;
            }
            let seen: Option<Vec<[f32; 2]>> = tile.iter().map(|&p| self.pixel(p)).collect();
            for (k, [x, y]) in seen.unwrap_or_default().into_iter().enumerate() {
                let _ = write!(path, "{}{x:.1} {y:.1}", if k == 0 { 'M' } else { 'L' });
            }
            path.push('Z');
        }
        // One path in one colour: tiles that touch leave no seams.
        svg.raw(&format!("<path d=\"{path}\" fill=\"{colour}\" opacity=\"{opacity}\"/>"));
    }

    /// A circle in the world: centre, unit normal, radius in metres.
    pub(crate) fn circle(&self, svg: &mut Svg, centre: Vec3, normal: Vec3, radius: f32, colour: &str, width: f32) {
        let (u, v) = normal.any_orthonormal_pair();
        let points: Vec<Vec3> = (0..=48)
            .map(|i| {
                let (s, c) = (i as f32 / 48.0 * std::f32::consts::TAU).sin_cos();
                centre + (u * c + v * s) * radius
            })
            .collect();
        self.polyline(svg, &points, colour, width);
    }
}
