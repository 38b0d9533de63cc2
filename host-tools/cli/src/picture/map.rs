//! The height map seen from above, forward up, with what was found on it.

use isobath::glam::Vec3;
use isobath::localized::height_map::{HeightCell, HeightMap};

use super::colours;
use super::raster::Raster;
use super::svg::Svg;

/// Width of the drawing in its own pixels, so that letters have one size whatever the map's.
const WIDTH: f32 = 480.0;

/// A part of the map, drawn: turns world points into places in the drawing.
#[derive(Debug)]
pub(crate) struct MapDrawing {
    pub(crate) svg: Svg,
    first: (usize, usize),
    last: (usize, usize),
    right: Vec3,
    forward: Vec3,
    corner: Vec3,
    cell: f32,
    /// Drawing pixels per cell.
    scale: f32,
}

/// The height that a cell is shown with: what one would bump into or step on.
pub(crate) fn shown_height(cell: &HeightCell) -> f32 {
    cell.max
}

/// Low is violet, 1.2 m and more red.
pub(crate) fn height_colour(height: f32) -> [u8; 3] {
    colours::turbo(0.06 + 0.9 * (height / TALL).clamp(0.0, 1.0))
}

/// The height at which the colour scale ends, metres.
pub(crate) const TALL: f32 = 1.2;

/// What can be walked on, light grey: the eye finds it at once between the colours of what stands on it.
const WALKABLE: [u8; 3] = [214, 222, 214];

impl MapDrawing {
    /// Draws the known part, with a margin that takes in `also`; `walkable` says where one can stand.
    pub(crate) fn new(map: &HeightMap<'_>, also: &[Vec3], walkable: impl Fn(usize, usize) -> bool) -> Self {
        let grid = map.grid();
        let (w, h) = grid.size();
        let known = |x: usize, y: usize| map.cell(x, y).is_some_and(HeightCell::is_known);
        let (mut first, mut last) = ((w, h), (0, 0));
        let mut take = |x: usize, y: usize| {
            first = (first.0.min(x), first.1.min(y));
            last = (last.0.max(x), last.1.max(y));
        };
        (0..h).flat_map(|y| (0..w).map(move |x| (x, y))).filter(|&(x, y)| known(x, y)).for_each(|(x, y)| take(x, y));
        also.iter().filter_map(|&p| grid.cell_of(p)).for_each(|(x, y)| take(x, y));
        if first.0 > last.0 {
            (first, last) = ((0, 0), (w.saturating_sub(1), h.saturating_sub(1)));
        }
        let margin = 4;
        first = (first.0.saturating_sub(margin), first.1.saturating_sub(margin));
        last = ((last.0 + margin).min(w.saturating_sub(1)), (last.1 + margin).min(h.saturating_sub(1)));
        let (cw, ch) = (last.0 - first.0 + 1, last.1 - first.1 + 1);
        let raster = Raster::from_fn(cw, ch, |x, y| {
            let (x, y) = (first.0 + x, last.1 - y);
            match map.cell(x, y) {
                Some(_) if walkable(x, y) => WALKABLE,
                Some(cell) if cell.is_known() => height_colour(shown_height(cell)),
                _ => colours::HOLE,
            }
        });
        let scale = WIDTH / cw.max(1) as f32;
        let (dw, dh) = (WIDTH, ch as f32 * scale);
        let mut svg = Svg::new(dw, dh, "height map from above");
        svg.picture(&raster, -0.5, -0.5, dw, dh, true);
        let corner = grid.point_of(0, 0, 0.0);
        let side = |p: Vec3| (p - corner).try_normalize().unwrap_or(Vec3::ZERO);
        let (right, forward) = (side(grid.point_of(1, 0, 0.0)), side(grid.point_of(0, 1, 0.0)));
        let mut drawing = Self { svg, first, last, right, forward, corner, cell: grid.cell(), scale };
        drawing.metre_lines(dw, dh);
        drawing
    }

    /// Where a world point lies in the drawing.
    pub(crate) fn at(&self, point: Vec3) -> [f32; 2] {
        let d = point - self.corner;
        let u = d.dot(self.right) / self.cell - self.first.0 as f32;
        let v = self.last.1 as f32 - d.dot(self.forward) / self.cell;
        [(u + 0.5) * self.scale - 0.5, (v + 0.5) * self.scale - 0.5]
    }

    /// Metres to drawing pixels.
    pub(crate) fn length(&self, metres: f32) -> f32 {
        metres / self.cell * self.scale
    }

    pub(crate) fn line(&mut self, points: &[Vec3], colour: &str, width: f32, extra: &str) {
        let points: Vec<[f32; 2]> = points.iter().map(|&p| self.at(p)).collect();
        self.svg.polyline(&points, colour, width, extra);
    }

    pub(crate) fn polygon(&mut self, points: &[Vec3], fill: &str, extra: &str) {
        let points: Vec<[f32; 2]> = points.iter().map(|&p| self.at(p)).collect();
        self.svg.polygon(&points, fill, extra);
    }

    /// A dot with its name.
    pub(crate) fn place(&mut self, point: Vec3, name: &str, colour: &str) {
        let [x, y] = self.at(point);
        self.svg.circle([x, y], 5.5, colour, "stroke=\"#0b1016\" stroke-width=\"1.5\"");
        self.svg.label([x + 10.0, y + 4.5], 14.0, name, colour, "start");
    }

    /// A bar of one metre in the lower left corner, and thin lines every metre.
    fn metre_lines(&mut self, w: f32, h: f32) {
        let metre = self.length(1.0);
        let faint = "stroke-opacity=\"0.22\"";
        let mut x = 12.0 + metre;
        while x < w {
            self.svg.polyline(&[[x, 0.0], [x, h]], "#ffffff", 0.8, faint);
            x += metre;
        }
        let mut y = h - 14.0 - metre;
        while y > 0.0 {
            self.svg.polyline(&[[0.0, y], [w, y]], "#ffffff", 0.8, faint);
            y -= metre;
        }
        let y = h - 14.0;
        self.svg.polyline(&[[12.0, y], [12.0 + metre, y]], "#ffffff", 3.0, "");
        self.svg.label([12.0 + metre / 2.0, y - 6.0], 14.0, "1 m", "#ffffff", "middle");
    }
}
