//! Pictures of one frame: colour, depth with lines of equal depth, confidence, normals.

use isobath::sensing::depth::DepthSample;
use isobath::sensing::frame::DepthFrame;

use super::colours;
use super::raster::Raster;

/// The depths that a false-colour picture spans: all but the outermost hundredth at either end, metres.
pub(crate) fn depth_span<D: DepthSample>(frame: &DepthFrame<'_, D>) -> (f32, f32) {
    let mut z: Vec<f32> = frame.depth().rows().flatten().map(|v| v.metres(frame.unit())).filter(|&z| z > 0.0).collect();
    z.sort_unstable_by(f32::total_cmp);
    let at = |share: f32| z.get(((z.len() as f32 - 1.0) * share) as usize).copied();
    match (at(0.01), at(0.99)) {
        (Some(near), Some(far)) if far > near => (near, far),
        (Some(near), _) => (near * 0.95, near * 1.05),
        _ => (0.0, 1.0),
    }
}

/// A round step that gives about `lines` lines over a span.
pub(crate) fn round_step(span: f32, lines: f32) -> f32 {
    let rough = (span / lines).max(1e-6);
    let power = 10.0_f32.powf(rough.log10().floor());
    let step = [1.0, 2.0, 2.5, 5.0].into_iter().find(|s| s * power >= rough).unwrap_or(10.0);
    step * power
}

/// False-colour depth with isobaths, the lines of equal depth, `step` metres apart.
pub(crate) fn depth<D: DepthSample>(frame: &DepthFrame<'_, D>, (near, far): (f32, f32), step: f32) -> Raster {
    let (w, h) = frame.size();
    let band = |z: f32| (z / step).floor();
    Raster::from_fn(w, h, |x, y| {
        let z = frame.z(x, y);
        let colour = colours::depth(z, near, far);
        let crosses = [(x + 1, y), (x, y + 1)].into_iter().any(|(u, v)| {
            let other = frame.z(u, v);
            // Across an edge there is no line: the surface does not pass through.
            other > 0.0 && band(other) != band(z) && (other - z).abs() < 0.02 * z
        });
        if z > 0.0 && crosses { colour.map(|c| (f32::from(c) * 0.35) as u8) } else { colour }
    })
}

/// Confidence from dark (0) to light (full).
pub(crate) fn confidence<D: DepthSample>(frame: &DepthFrame<'_, D>) -> Option<Raster> {
    let view = frame.confidence()?;
    let (w, h) = frame.size();
    Some(Raster::from_fn(w, h, |x, y| {
        if frame.z(x, y) > 0.0 {
            confidence_colour(f32::from(view.get(x, y).unwrap_or(0)) / 255.0)
        } else {
            colours::HOLE
        }
    }))
}

/// The colour of a confidence from 0 to 1.
pub(crate) fn confidence_colour(share: f32) -> [u8; 3] {
    colours::turbo(0.95 - 0.6 * share)
}

/// Colour where there is a colour image, else shaded depth; always of the depth image's size, so that overlays fit.
pub(crate) fn scene<D: DepthSample>(frame: &DepthFrame<'_, D>, normals: &[[f32; 3]]) -> Raster {
    let (w, h) = frame.size();
    let has_colour = frame.colour().is_some();
    Raster::from_fn(w, h, |x, y| {
        if has_colour {
            return frame.colour_at(x, y).unwrap_or(colours::HOLE);
        }
        let facing = normals.get(y * w + x).map_or(f32::NAN, |n| -n[2]);
        if facing.is_finite() { [(40.0 + 180.0 * facing.clamp(0.0, 1.0)) as u8; 3] } else { colours::HOLE }
    })
}

/// Normals in camera axes.
pub(crate) fn normals(width: usize, height: usize, normals: &[[f32; 3]]) -> Raster {
    Raster::from_fn(width, height, |x, y| normals.get(y * width + x).map_or(colours::HOLE, |&n| colours::normal(n)))
}

/// The colours of all normals that face the camera, as a ball.
pub(crate) fn normal_ball(side: usize) -> Raster {
    Raster::from_fn(side, side, |x, y| {
        let at = |i: usize| (i as f32 + 0.5) / side as f32 * 2.0 - 1.0;
        let (nx, ny) = (at(x), at(y));
        let rest = 1.0 - nx * nx - ny * ny;
        if rest > 0.0 { colours::normal([nx, ny, -rest.sqrt()]) } else { [255; 3] }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_round() {
        assert!((round_step(2.9, 12.0) - 0.25).abs() < 1e-6);
        assert!((round_step(10.0, 10.0) - 1.0).abs() < 1e-6);
        assert!(round_step(0.0, 10.0) > 0.0);
    }
}
