//! A small cube map: the form in which game engines and GPUs take light.
//!
//! Six square faces below one another, in OpenGL's order and orientation: +x, -x, +y, -y, +z, -z, each as seen from inside with OpenGL's `sc`, `tc`
//! (table 8.19 of its specification). Axes are the map's. A pixel holds the light in its middle: the far field is smoother than any face of 32
//! pixels and more; sharper light (a whole map) wants faces as fine as it is, or `samples` above 1.

use glam::Vec3;

use crate::ground::colour::Colour;
use crate::ground::image::ImageViewMut;

/// The faces, from the top.
pub const FACES: usize = 6;

/// The direction (of length 1 to sqrt 3) at a face's position, both coordinates from -1 to 1, left to right and top to bottom.
#[must_use]
pub const fn direction_of_face(face: usize, across: f32, down: f32) -> Vec3 {
    let (s, t) = (across, down);
    match face {
        0 => Vec3::new(1.0, -t, -s),
        1 => Vec3::new(-1.0, -t, s),
        2 => Vec3::new(s, 1.0, t),
        3 => Vec3::new(s, -1.0, -t),
        4 => Vec3::new(s, -t, 1.0),
        _ => Vec3::new(-s, -t, -1.0),
    }
}

/// Draws a cube map from anything that knows the light from a unit direction; each pixel the mean of `samples` x `samples` of them. The
/// image is six times as high as wide: false, and nothing drawn, if it is not.
///
/// ```
/// use isobath::ground::image::ImageViewMut;
/// use isobath::lighting::cube;
/// use isobath::lighting::far::{FarField, FarParams, extrapolate::FarMap};
/// let mut far = FarField::<1280>::new(FarParams::default(), [0.5; 3]);
/// let mut grid = FarMap::<64, 32>::new();
/// grid.update(&mut far);
/// let mut pixels = [[0_u8; 3]; 8 * 8 * cube::FACES];
/// assert!(cube::draw(&mut ImageViewMut::new(&mut pixels, 8, 48)?, 1, |d| grid.towards(d)));
/// assert!(pixels.iter().all(|p| *p == [188; 3])); // half the light is sRGB 188
/// # Ok::<(), isobath::ground::image::ImageError>(())
/// ```
pub fn draw<C: Colour>(out: &mut ImageViewMut<'_, C>, samples: usize, mut light: impl FnMut(Vec3) -> [f32; 3]) -> bool {
    let (size, height) = out.size();
    if size.checked_mul(FACES) != Some(height) {
        return false;
    }
    let samples = samples.max(1);
    let position =
        |pixel: usize, sample: usize| 2.0 * (pixel as f32 + (sample as f32 + 0.5) / samples as f32) / size as f32 - 1.0;
    for y in 0..height {
        let (face, row) = (y / size.max(1), y % size.max(1));
        for x in 0..size {
            let mut sum = [0.0; 3];
            for j in 0..samples {
                for i in 0..samples {
                    let d = direction_of_face(face, position(x, i), position(row, j));
                    let d = d * crate::ground::math::inv_sqrt(d.length_squared());
                    for (sum, v) in sum.iter_mut().zip(light(d)) {
                        *sum += v;
                    }
                }
            }
            out.set(x, y, C::of_linear(sum.map(|s| s / (samples * samples) as f32)));
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_meet_at_their_edges_and_look_their_way() {
        let axes = [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y, Vec3::Z, -Vec3::Z];
        for (face, axis) in axes.into_iter().enumerate() {
            assert_eq!(direction_of_face(face, 0.0, 0.0), axis);
        }
        // OpenGL: +z's right edge is +x's left, its top is +y's bottom edge.
        for t in [-1.0, -0.3, 0.5, 1.0] {
            assert_eq!(direction_of_face(4, 1.0, t), direction_of_face(0, -1.0, t));
            assert_eq!(direction_of_face(4, -1.0, t), direction_of_face(1, 1.0, t));
            assert_eq!(direction_of_face(4, t, -1.0), direction_of_face(2, t, 1.0));
            assert_eq!(direction_of_face(4, t, 1.0), direction_of_face(3, t, -1.0));
            assert_eq!(direction_of_face(5, -1.0, t), direction_of_face(0, 1.0, t));
        }
    }

    #[test]
    fn pixels_are_means_and_shapes_are_checked() {
        let mut pixels = [[0.0_f32; 3]; 2 * 2 * 6];
        let mut view = ImageViewMut::new(&mut pixels, 2, 12).unwrap();
        assert!(draw(&mut view, 4, |d| [d.x.max(0.0), 1.0, 0.0]));
        assert!(pixels[0][0] > 0.7 && pixels[4][0] == 0.0 && pixels.iter().all(|p| p[1] == 1.0));
        assert!(!draw(&mut ImageViewMut::new(&mut pixels, 2, 11).unwrap(), 1, |_| [0.0; 3]));
        assert!(draw(&mut ImageViewMut::<[f32; 3]>::new(&mut [], 0, 0).unwrap(), 1, |_| [0.0; 3]));
    }
}
