//! How close a map is to the truth, as a map and as the light of three balls.
//!
//! All maps are brought to one size; colours are sRGB bytes, as on a screen, 1 being a camera's white. PSNR of maps weighs pixels with their
//! solid angle: equirectangular rows near the poles show little. SSIM (Wang et al. 2004: Gaussian window, sigma 1.5, of 11 pixels; luma) is taken at half
//! the size, and of balls only where the ball is.

use isobath::ground::colour::Colour;
use isobath_sim::{Ball, LinearImage, Rigid, covers, render_ball};

use super::SIZE;

/// Balls and the sides of their pictures, pixels.
pub(super) const BALLS: [(Ball, usize); 3] = [(Ball::Mirror, 96), (Ball::Glossy, 32), (Ball::Diffuse, 32)];

/// Two ways to say how alike two pictures are; more is better.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Alike {
    /// Peak signal to noise ratio, dB; at most 100.
    pub psnr: f64,
    /// Structural similarity, at most 1.
    pub ssim: f64,
}

/// A map's worth.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Quality {
    /// Of the map.
    pub map: Alike,
    /// Of the mirror, the glossy and the diffuse ball under it.
    pub balls: [Alike; 3],
}

impl Quality {
    /// PSNR and SSIM of map, mirror, glossy, diffuse.
    pub(super) fn numbers(&self) -> [f64; 8] {
        let [mirror, glossy, diffuse] = self.balls;
        let all = [self.map, mirror, glossy, diffuse];
        let (psnr, ssim) = (all.map(|a| a.psnr), all.map(|a| a.ssim));
        std::array::from_fn(|i| if i < 4 { psnr[i] } else { ssim[i - 4] })
    }
}

/// Numbers of several qualities: the mean of each.
pub(super) fn mean<'a>(all: impl Iterator<Item = &'a Quality>) -> [f64; 8] {
    let (mut sum, mut n) = ([0.0; 8], 0.0);
    for quality in all {
        n += 1.0;
        for (sum, v) in sum.iter_mut().zip(quality.numbers()) {
            *sum += v;
        }
    }
    sum.map(|s| s / n)
}

/// What maps are compared with: seen once, from one side.
#[derive(Debug)]
pub(super) struct Truth {
    /// Of the map, at [`SIZE`].
    bytes: Vec<[u8; 3]>,
    luma: Grey,
    views: Vec<Rigid>,
    /// For each view.
    balls: Vec<[LinearImage; 3]>,
}

impl Truth {
    /// Of a map, with the balls as seen from some sides.
    pub(super) fn new(map: &LinearImage, views: Vec<Rigid>) -> Self {
        let map = brought(map);
        let bytes = map.pixels.iter().map(|p| <[u8; 3]>::of_linear(*p)).collect();
        let luma = Grey::of(&shrunk(&map, SIZE.0 / 2));
        let balls = views.iter().map(|view| render(&map, view)).collect();
        Self { bytes, luma, views, balls }
    }

    /// A map's quality; the balls as seen from side `view`.
    pub(super) fn score(&self, map: &LinearImage, view: usize) -> Quality {
        let map = brought(map);
        let bytes: Vec<[u8; 3]> = map.pixels.iter().map(|p| <[u8; 3]>::of_linear(*p)).collect();
        let solid = |i: usize| solid_angle(i / SIZE.0, SIZE.1);
        let psnr = psnr(bytes.iter().zip(&self.bytes).enumerate().map(|(i, (a, b))| (*a, *b, solid(i))));
        let half = Grey::of(&shrunk(&map, SIZE.0 / 2));
        let ssim = ssim(&half, &self.luma, true, |_, y| solid_angle(y, half.height));
        let mut balls = [Alike::default(); 3];
        if let (Some(side), Some(truth)) = (self.views.get(view), self.balls.get(view)) {
            let pictures = render(&map, side);
            for ((alike, (a, b)), (_, size)) in balls.iter_mut().zip(pictures.iter().zip(truth)).zip(BALLS) {
                *alike = ball(a, b, size);
            }
        }
        Quality { map: Alike { psnr, ssim }, balls }
    }
}

/// The three balls. Lobes and the mirror's own pixels are wider than a fine map's: maps are shrunk first, which also saves most of the time.
fn render(map: &LinearImage, view: &Rigid) -> [LinearImage; 3] {
    let (fine, coarse) = (shrunk(map, 256), shrunk(map, 128));
    BALLS.map(|(ball, size)| render_ball(if ball == Ball::Mirror { &fine } else { &coarse }, ball, view, size))
}

fn ball(a: &LinearImage, b: &LinearImage, size: usize) -> Alike {
    let on = |i: usize| covers(i % size, i / size, size);
    let pairs = a.pixels.iter().zip(&b.pixels).enumerate().filter(|(i, _)| on(*i));
    let psnr = psnr(pairs.map(|(_, (a, b))| (<[u8; 3]>::of_linear(*a), <[u8; 3]>::of_linear(*b), 1.0)));
    let ssim = ssim(&Grey::of(a), &Grey::of(b), false, |x, y| f64::from(u8::from(covers(x, y, size))));
    Alike { psnr, ssim }
}

/// Of a pixel in a row of a map, up to a common factor.
pub(super) fn solid_angle(row: usize, rows: usize) -> f64 {
    (std::f64::consts::PI * (row as f64 + 0.5) / rows as f64).sin()
}

/// Of pairs of pixels with their weights.
pub(super) fn psnr(pairs: impl Iterator<Item = ([u8; 3], [u8; 3], f64)>) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for (a, b, weight) in pairs {
        for (a, b) in a.into_iter().zip(b) {
            let off = f64::from(a.abs_diff(b)) / 255.0;
            sum += weight * off * off;
        }
        weights += 3.0 * weight;
    }
    -10.0 * (sum / weights).max(1e-10).log10()
}

/// A map at [`SIZE`]: larger ones by the mean, smaller ones bilinear, as a renderer would look them up.
pub(super) fn brought(map: &LinearImage) -> LinearImage {
    let (w, h) = SIZE;
    if map.width == w && map.height == h {
        return map.clone();
    }
    if map.width > w {
        return shrunk(map, w);
    }
    let mut out = LinearImage::filled(w, h, [0.0; 3]);
    for (i, pixel) in out.pixels.iter_mut().enumerate() {
        let (u, v) = (((i % w) as f64 + 0.5) / w as f64, ((i / w) as f64 + 0.5) / h as f64);
        let colour = map.towards(isobath_sim::direction_of_equirect(u, v));
        *pixel = [colour.x as f32, colour.y as f32, colour.z as f32];
    }
    out
}

/// A map `width` wide, by the mean over solid angles; as it is when no larger.
pub(super) fn shrunk(map: &LinearImage, width: usize) -> LinearImage {
    let n = map.width / width.max(1);
    if n < 2 {
        return map.clone();
    }
    let height = map.height / n;
    let mut out = LinearImage::filled(width, height, [0.0; 3]);
    for (y, row) in out.pixels.chunks_mut(width).enumerate() {
        let mut weights = 0.0;
        for from in n * y..n * (y + 1) {
            let solid = solid_angle(from, map.height) as f32;
            weights += solid * n as f32;
            let pixels = map.pixels.get(from * map.width..).unwrap_or_default();
            for (to, from) in row.iter_mut().zip(pixels.chunks(n)) {
                for pixel in from {
                    for (to, v) in to.iter_mut().zip(pixel) {
                        *to += solid * v;
                    }
                }
            }
        }
        for pixel in row {
            *pixel = pixel.map(|v| v / weights);
        }
    }
    out
}

/// Luma of sRGB bytes, 0 to 1.
#[derive(Debug, Clone)]
struct Grey {
    width: usize,
    height: usize,
    pixels: Vec<f64>,
}

impl Grey {
    fn of(image: &LinearImage) -> Self {
        let luma = |p: &[f32; 3]| {
            let [r, g, b] = <[u8; 3]>::of_linear(*p).map(|v| f64::from(v) / 255.0);
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        Self { width: image.width, height: image.height, pixels: image.pixels.iter().map(luma).collect() }
    }

    fn with(&self, other: &Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let pixels = self.pixels.iter().zip(&other.pixels).map(|(a, b)| f(*a, *b)).collect();
        Self { pixels, ..*self }
    }

    /// Blurred by the window; columns close to a ring when they `wrap`, else the border repeats.
    fn blurred(&self, wrap: bool) -> Vec<f64> {
        const REACH: isize = 5;
        let window: Vec<f64> = (-REACH..=REACH).map(|d| (-(d * d) as f64 / 4.5).exp()).collect();
        let total: f64 = window.iter().sum();
        let (w, h) = (self.width as isize, self.height as isize);
        let pass = |from: &[f64], dx: isize, dy: isize| -> Vec<f64> {
            let at = |x: isize, y: isize| {
                let x = if wrap { x.rem_euclid(w) } else { x.clamp(0, w - 1) };
                from.get((y.clamp(0, h - 1) * w + x) as usize).copied().unwrap_or_default()
            };
            let sum = |x: isize, y: isize| {
                let terms = window.iter().zip(-REACH..=REACH).map(|(k, d)| k * at(x + d * dx, y + d * dy));
                terms.sum::<f64>() / total
            };
            (0..h).flat_map(|y| (0..w).map(move |x| (x, y))).map(|(x, y)| sum(x, y)).collect()
        };
        pass(&pass(&self.pixels, 1, 0), 0, 1)
    }
}

fn ssim(a: &Grey, b: &Grey, wrap: bool, weight: impl Fn(usize, usize) -> f64) -> f64 {
    const C1: f64 = 0.01 * 0.01;
    const C2: f64 = 0.03 * 0.03;
    let squares = |g: &Grey| g.with(g, |a, b| a * b).blurred(wrap);
    let (ma, mb) = (a.blurred(wrap), b.blurred(wrap));
    let (aa, bb, ab) = (squares(a), squares(b), a.with(b, |a, b| a * b).blurred(wrap));
    let (mut sum, mut weights) = (0.0, 0.0);
    for (i, ((((ma, mb), aa), bb), ab)) in ma.iter().zip(&mb).zip(&aa).zip(&bb).zip(&ab).enumerate() {
        let [ma, mb, aa, bb, ab] = [ma, mb, aa, bb, ab].map(|v| *v);
        let (va, vb, vab) = ((aa - ma * ma).max(0.0), (bb - mb * mb).max(0.0), ab - ma * mb);
        let here = (2.0 * ma * mb + C1) * (2.0 * vab + C2) / ((ma * ma + mb * mb + C1) * (va + vb + C2));
        let w = weight(i % a.width.max(1), i / a.width.max(1));
        sum += w * here;
        weights += w;
    }
    sum / weights
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobath_sim::{V3, v3};

    fn pattern() -> LinearImage {
        let (w, h) = SIZE;
        let pixels =
            (0..w * h).map(|i| if (i % w / 16 + i / w / 16) % 2 == 0 { [0.8, 0.6, 0.4] } else { [0.1, 0.2, 0.3] });
        LinearImage { width: w, height: h, pixels: pixels.collect() }
    }

    #[test]
    fn the_truth_is_perfect_and_less_is_less() {
        let view = Rigid::looking_at(v3(0.0, 0.3, 1.0), V3::ZERO);
        let truth = Truth::new(&pattern(), vec![view]);
        let q = truth.score(&pattern(), 0);
        for alike in [q.map, q.balls[0], q.balls[1], q.balls[2]] {
            assert!(alike.psnr > 99.9 && (alike.ssim - 1.0).abs() < 1e-6, "{q:?}");
        }
        let mut grey = pattern();
        grey.pixels.iter_mut().for_each(|p| *p = p.map(|v| 0.5 * v + 0.2));
        let worse = truth.score(&grey, 0);
        assert!(worse.map.psnr < 25.0 && worse.map.ssim < 0.95 && worse.map.ssim > 0.5, "{worse:?}");
        let flat = truth.score(&LinearImage::filled(64, 32, [0.4; 3]), 0);
        assert!(flat.map.ssim < worse.map.ssim && flat.balls[2].psnr > flat.balls[0].psnr, "{flat:?}");
        assert_eq!(mean([q, worse].iter())[0], 0.5 * (q.map.psnr + worse.map.psnr));
    }

    #[test]
    fn psnr_is_what_it_is() {
        // One channel of three off by 51 of 255: a mean square of 0.04 / 3.
        let pair = ([51, 0, 0], [0, 0, 0], 2.0);
        assert!((psnr([pair].into_iter()) - 18.751).abs() < 1e-3);
        // Without weight it does not count.
        assert!(psnr([([255; 3], [0; 3], 0.0), ([9; 3], [9; 3], 1.0)].into_iter()) > 99.0);
    }

    #[test]
    fn maps_of_all_sizes_are_brought_to_one() {
        for (w, h) in [(96, 48), (512, 256), (1024, 512)] {
            let out = brought(&LinearImage::filled(w, h, [0.3, 0.2, 0.1]));
            assert_eq!((out.width, out.height), SIZE);
            assert!(out.pixels.iter().all(|p| (p[0] - 0.3).abs() < 1e-6 && (p[2] - 0.1).abs() < 1e-6));
        }
    }
}
