//! Balls under an environment map: the usual way to see whether an estimated map lights an object right.
//!
//! The ball is seen from far away (orthographic), so that a map alone lights it. Mirror looks the reflected direction up; glossy
//! takes the mean of the map around it, weighted with the cosine to a power; diffuse takes the mean over the hemisphere, weighted with
//! the cosine. Both means divide by the sum of their weights, so that a uniform map gives a uniform ball, exactly the map's
//! colour. They run over the map reduced to at most 64 columns (each pixel weighted with its solid angle).

use rayon::prelude::*;

use super::sky::{LinearImage, direction_of_equirect};
use crate::maths::{Rigid, V3, v3};

/// What a ball is made of; none of them absorbs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ball {
    /// Perfect mirror.
    Mirror,
    /// Phong lobe of exponent 32 around the mirrored direction.
    Glossy,
    /// Lambert.
    Diffuse,
}

/// A cell of the map as a light. It shines from where its own light comes from: a sun is smaller than a cell, and a cell's middle
/// would be off by up to 4 degrees.
struct Lamp {
    /// The mean direction of the cell's pixels.
    direction: V3,
    /// The same, each pixel weighted with its brightness.
    bright: V3,
    /// Sum over the pixels, each times its solid angle.
    colour: V3,
    /// The solid angle, up to a factor that all have in common.
    weight: f64,
}

/// Columns of the reduced map.
const REDUCED: usize = 64;

fn lamps(map: &LinearImage) -> Vec<Lamp> {
    let (w, h) = (map.width.min(REDUCED), map.height.min(REDUCED / 2));
    let dark = || Lamp { direction: V3::ZERO, bright: V3::ZERO, colour: V3::ZERO, weight: 0.0 };
    let mut lamps: Vec<Lamp> = std::iter::repeat_with(dark).take(w * h).collect();
    for y in 0..map.height {
        // The solid angle of a row's pixel, up to a common factor.
        let solid = libm::sin(std::f64::consts::PI * (y as f64 + 0.5) / map.height as f64);
        for x in 0..map.width {
            if let Some(lamp) = lamps.get_mut(y * h / map.height * w + x * w / map.width) {
                let (u, v) = ((x as f64 + 0.5) / map.width as f64, (y as f64 + 0.5) / map.height as f64);
                let (direction, colour) = (direction_of_equirect(u, v), V3::from(map.get(x, y).map(f64::from)));
                lamp.direction += direction * solid;
                lamp.bright += direction * (solid * colour.dot(V3::ONE));
                lamp.colour += colour * solid;
                lamp.weight += solid;
            }
        }
    }
    for lamp in &mut lamps {
        lamp.direction = lamp.direction.unit_or_up();
        lamp.bright = lamp.bright.unit().unwrap_or(lamp.direction);
    }
    lamps
}

/// The ball's picture, `size` x `size`, seen by a camera that is turned as `view` (only its rotation counts; the camera looks along its
/// own z). Outside the ball is black; [`covers`] says where.
#[must_use]
pub fn render_ball(map: &LinearImage, ball: Ball, view: &Rigid, size: usize) -> LinearImage {
    let lamps = lamps(map);
    let gather = |axis: V3, power: u32| {
        let (mut sum, mut weights) = (V3::ZERO, 0.0);
        for lamp in &lamps {
            let share = |direction: V3| (0..power).fold(axis.dot(direction).max(0.0), |c, _| c * c);
            sum += lamp.colour * share(lamp.bright);
            weights += lamp.weight * share(lamp.direction);
        }
        if weights > 0.0 { sum / weights } else { V3::ZERO }
    };
    let mut image = LinearImage::filled(size, size, [0.0; 3]);
    image.pixels.par_chunks_mut(size.max(1)).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            let Some(own) = normal(x, y, size) else { continue };
            let n = view.rotation.apply(own);
            let look = view.rotation.z;
            let mirrored = look - n * (2.0 * look.dot(n));
            *pixel = match ball {
                Ball::Mirror => map.towards(mirrored),
                Ball::Glossy => gather(mirrored, 5),
                Ball::Diffuse => gather(n, 0),
            }
            .to_f32();
        }
    });
    image
}

/// The ball's normal in the camera's frame at a pixel.
fn normal(x: usize, y: usize, size: usize) -> Option<V3> {
    let c = |i: usize| (2.0 * i as f64 + 1.0) / size as f64 - 1.0;
    let (nx, ny) = (c(x), c(y));
    let rest = 1.0 - nx * nx - ny * ny;
    (rest > 0.0).then(|| v3(nx, ny, -rest.sqrt()))
}

/// Whether the ball covers a pixel of its picture.
#[must_use]
pub fn covers(x: usize, y: usize, size: usize) -> bool {
    normal(x, y, size).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_in_uniform_out() {
        let colour = [0.25_f32, 1.5, 7.0];
        let map = LinearImage::filled(100, 50, colour);
        for ball in [Ball::Mirror, Ball::Glossy, Ball::Diffuse] {
            let picture = render_ball(&map, ball, &Rigid::looking_at(v3(1.0, 2.0, 3.0), V3::ZERO), 24);
            let mut covered = 0;
            for y in 0..24 {
                for x in 0..24 {
                    let p = picture.get(x, y);
                    if covers(x, y, 24) {
                        covered += 1;
                        assert!((0..3).all(|i| (p[i] / colour[i] - 1.0).abs() < 1e-6), "{ball:?} {p:?}");
                    } else {
                        assert_eq!(p, [0.0; 3]);
                    }
                }
            }
            assert!((covered as f64 / 576.0 - std::f64::consts::FRAC_PI_4).abs() < 0.02);
        }
    }

    #[test]
    fn a_small_sun_lights_as_the_cosines_say() {
        // One pixel of a fine map, at the corner of a cell of the reduced one. The mean over the hemisphere divides by pi, that
        // over the lobe by 2 pi / 33.
        let mut map = LinearImage::filled(512, 256, [0.0; 3]);
        let (x, y) = (8 * 21, 8 * 12);
        map.pixels[y * 512 + x] = [1000.0; 3];
        let sun = direction_of_equirect((x as f64 + 0.5) / 512.0, (y as f64 + 0.5) / 256.0);
        let side = std::f64::consts::TAU / 512.0;
        let irradiance = 1000.0 * side * side * libm::sin(std::f64::consts::PI * (y as f64 + 0.5) / 256.0);
        let view = Rigid::looking_at(V3::ZERO, v3(0.4, -0.1, 1.0));
        for (ball, power, total) in
            [(Ball::Diffuse, 0, std::f64::consts::PI), (Ball::Glossy, 5, std::f64::consts::TAU / 33.0)]
        {
            let picture = render_ball(&map, ball, &view, 48);
            let exact = |x: usize, y: usize| {
                let n = view.rotation.apply(normal(x, y, 48)?);
                let look = view.rotation.z;
                let axis = if power == 0 { n } else { look - n * (2.0 * look.dot(n)) };
                Some((0..power).fold(axis.dot(sun).max(0.0), |c, _| c * c) * irradiance / total)
            };
            let most = irradiance / total;
            let mut lit = 0;
            for i in 0..48 * 48 {
                let Some(e) = exact(i % 48, i / 48) else { continue };
                let got = f64::from(picture.get(i % 48, i / 48)[0]);
                lit += usize::from(e > 0.1 * most);
                assert!((got - e).abs() < 0.005 * most, "{ball:?} {i}: {got} {e}");
            }
            assert!(lit > 40, "{ball:?} {lit}");
        }
    }

    #[test]
    fn a_light_above_lights_the_top() {
        let mut map = LinearImage::filled(64, 32, [0.0; 3]);
        map.pixels[..128].fill([1.0; 3]);
        let view = Rigid::looking_at(v3(0.0, 0.0, 2.0), V3::ZERO);
        for ball in [Ball::Glossy, Ball::Diffuse] {
            let picture = render_ball(&map, ball, &view, 33);
            assert!(picture.get(16, 6)[0] > 4.0 * picture.get(16, 26)[0].max(1e-9), "{ball:?}");
        }
        let mirror = render_ball(&map, Ball::Mirror, &view, 201);
        // The normal half way between up and the viewer shows what is straight above: row at sin 45 degrees.
        assert!(mirror.get(100, 30)[0] > 0.9 && mirror.get(100, 100)[0] == 0.0);
        assert_eq!(render_ball(&LinearImage::default(), Ball::Diffuse, &view, 4).pixels, vec![[0.0; 3]; 16]);
    }
}
