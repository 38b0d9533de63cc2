//! Colour as Y, Cb and Cr, chroma halved both ways, only where it is wanted, in about two bits a pixel.
//!
//! RGB becomes full-range BT.601 (that of JPEG and of the paper's iOS camera frames) in integers. A chroma sample is the mean of
//! those of its 2 x 2 pixels that are wanted. Each plane is rounded to steps of 2 e + 1, so that no sample is off by more than
//! e, and the rounded plane is coded without loss: predicted from the left, upper and upper left neighbours (the median of
//! JPEG-LS, Weinberger 2000), the difference zigzagged and written in Rice codes whose parameter follows the mean of what came before
//! in the same kind of place (nine classes of how much the neighbours differ, JPEG-LS's estimator). Rounding comes first and
//! not in the loop: the encoder then needs no memory of what the decoder will see.
//!
//! Where a neighbour is not wanted its place is taken by the nearest that is. A sample takes 2 bytes at worst.

use crate::ground::image::{ImageView, ImageViewMut};

use super::KeyFrameError;

/// Y, Cb, Cr of a pixel.
pub(super) fn ycc([r, g, b]: [u8; 3]) -> [u8; 3] {
    let [r, g, b] = [r, g, b].map(i32::from);
    let y = (77 * r + 150 * g + 29 * b + 128) >> 8;
    let cb = ((-43 * r - 85 * g + 128 * b + 128) >> 8) + 128;
    let cr = ((128 * r - 107 * g - 21 * b + 128) >> 8) + 128;
    [y, cb, cr].map(byte)
}

/// And back.
pub(super) fn rgb([y, cb, cr]: [u8; 3]) -> [u8; 3] {
    let (y, cb, cr) = (i32::from(y), i32::from(cb) - 128, i32::from(cr) - 128);
    let r = y + ((359 * cr + 128) >> 8);
    let g = y - ((88 * cb + 183 * cr + 128) >> 8);
    let b = y + ((454 * cb + 128) >> 8);
    [r, g, b].map(byte)
}

fn byte(v: i32) -> u8 {
    v.clamp(0, 255) as u8
}

/// Rounding to steps, of which one is 128: grey stays grey.
#[derive(Clone, Copy)]
struct Steps {
    step: u32,
    /// 2^16 / step, rounded up: dividing numbers below 2000 by multiplying with it is exact.
    inverse: u32,
    /// What is added before dividing: half a step, and whole steps that bring 0 to level 0.
    shift: u32,
    /// The level of 128.
    middle: i32,
    levels: i32,
}

impl Steps {
    /// No value off by more than `error`, 0 to 15.
    const fn new(error: u8) -> Self {
        let error = error as u32;
        let step = 2 * error + 1;
        let middle = (128 + error) / step;
        let levels = middle + (127 + error) / step + 1;
        let inverse = (1_u32 << 16).div_ceil(step);
        Self { step, inverse, shift: middle * step + error - 128, middle: middle as i32, levels: levels as i32 }
    }

    #[inline(always)]
    const fn level(self, v: u8) -> i32 {
        (((v as u32 + self.shift) * self.inverse) >> 16) as i32
    }

    #[inline(always)]
    fn value(self, level: i32) -> u8 {
        byte((level - self.middle) * self.step as i32 + 128)
    }
}

/// What neighbours say of a sample: its likely level, and how sure that is (0: sure, 8: not at all).
#[inline]
fn predict(left: i32, up: i32, corner: i32) -> (i32, usize) {
    let (low, high) = (left.min(up), left.max(up));
    let likely = (left + up - corner).clamp(low, high);
    let unrest = left.abs_diff(corner) + up.abs_diff(corner);
    (likely, (32 - unrest.leading_zeros()).min(8) as usize)
}

/// How large differences were in one class of places, and the Rice parameter that suits them: the least k for which
/// `count << k` reaches `sum`, at most 7.
#[derive(Clone, Copy)]
struct Class {
    sum: u32,
    count: u32,
    k: u32,
}

impl Class {
    const NEW: Self = Self { sum: 2, count: 1, k: 1 };

    const fn learn(&mut self, value: u32) {
        self.sum += value;
        self.count += 1;
        if self.count == 64 {
            (self.sum, self.count) = (self.sum >> 1, 32);
        }
        // It seldom moves, and then by one.
        while self.k < 7 && self.count << self.k < self.sum {
            self.k += 1;
        }
        while self.k > 0 && self.count << (self.k - 1) >= self.sum {
            self.k -= 1;
        }
    }
}

/// The state of one plane: the row before is asked for, the row at hand is remembered.
struct Coder {
    steps: Steps,
    classes: [Class; 9],
    /// The sample to the left, or what stands in for it; and the one above that.
    left: i32,
    corner: i32,
    /// Whether the row has had a sample.
    begun: bool,
}

/// Ones that begin a value written plainly.
const ESCAPE: u32 = 8;

impl Coder {
    fn new(error: u8) -> Self {
        let steps = Steps::new(error);
        // Where chroma mostly is.
        let middle = steps.middle;
        Self { steps, classes: [Class::NEW; 9], left: middle, corner: middle, begun: false }
    }

    const fn begin_row(&mut self) {
        self.begun = false;
    }

    fn expect(&self, up: Option<i32>) -> (i32, usize) {
        match (up, self.begun) {
            (Some(up), true) => predict(self.left, up, self.corner),
            (Some(up), false) => predict(up, up, up),
            (None, _) => predict(self.left, self.left, self.left),
        }
    }

    fn learn(&mut self, class: usize, value: u32, level: i32, up: Option<i32>) {
        if let Some(class) = self.classes.get_mut(class) {
            class.learn(value);
        }
        (self.left, self.corner, self.begun) = (level, up.unwrap_or(level), true);
    }

    fn bits_of(&self, class: usize) -> u32 {
        self.classes.get(class).map_or(0, |c| c.k)
    }

    fn write(&mut self, bits: &mut BitWriter<'_>, level: i32, up: Option<i32>) -> Result<(), KeyFrameError> {
        let (likely, class) = self.expect(up);
        // Round the circle of levels the shorter way.
        let levels = self.steps.levels;
        let way = level - likely;
        let way = if 2 * way >= levels { way - levels } else { way };
        let way = if 2 * way < -levels { way + levels } else { way };
        let value = (way << 1 ^ way >> 31) as u32;
        let k = self.bits_of(class);
        let quotient = value >> k;
        if quotient < ESCAPE {
            bits.put((2 << quotient) - 2, quotient + 1)?;
            bits.put(value & ((1 << k) - 1), k)?;
        } else {
            bits.put((1 << ESCAPE) - 1, ESCAPE)?;
            bits.put(value, 8)?;
        }
        self.learn(class, value, level, up);
        Ok(())
    }

    fn read(&mut self, bits: &mut BitReader<'_>, up: Option<i32>) -> Result<i32, KeyFrameError> {
        let (likely, class) = self.expect(up);
        let k = self.bits_of(class);
        let ones = bits.ones()?;
        let value = if ones < ESCAPE { ones << k | bits.take(k)? } else { bits.take(8)? };
        let way = (value >> 1) as i32 ^ -((value & 1) as i32);
        let levels = self.steps.levels;
        let level = likely + way;
        let level = if level < 0 { level + levels } else { level };
        let level = if level >= levels { level - levels } else { level };
        if level < 0 || level >= levels {
            return Err(KeyFrameError::Colour);
        }
        self.learn(class, value, level, up);
        Ok(level)
    }
}

/// Bits into bytes, first bit on top.
struct BitWriter<'a> {
    out: &'a mut [u8],
    at: usize,
    word: u32,
    held: u32,
}

impl BitWriter<'_> {
    /// Up to 16 bits.
    fn put(&mut self, value: u32, count: u32) -> Result<(), KeyFrameError> {
        self.word = self.word << count | value;
        self.held += count;
        while self.held >= 8 {
            self.held -= 8;
            let got = self.out.len();
            let place = self.out.get_mut(self.at).ok_or(KeyFrameError::Full { got })?;
            *place = (self.word >> self.held) as u8;
            self.at += 1;
        }
        Ok(())
    }

    fn finish(mut self) -> Result<usize, KeyFrameError> {
        if self.held > 0 {
            self.put(0, 8 - self.held)?;
        }
        Ok(self.at)
    }
}

/// Bytes into bits.
struct BitReader<'a> {
    bytes: &'a [u8],
    at: usize,
    /// The next bits, on top.
    word: u32,
    held: u32,
}

impl BitReader<'_> {
    /// At least 16 bits, while there are.
    fn fill(&mut self) {
        while self.held <= 24 {
            let Some(&byte) = self.bytes.get(self.at) else { return };
            self.word |= u32::from(byte) << (24 - self.held);
            self.held += 8;
            self.at += 1;
        }
    }

    fn drop(&mut self, count: u32) -> Result<(), KeyFrameError> {
        self.held = self.held.checked_sub(count).ok_or(KeyFrameError::Colour)?;
        self.word <<= count;
        Ok(())
    }

    /// Up to 8 bits.
    fn take(&mut self, count: u32) -> Result<u32, KeyFrameError> {
        self.fill();
        // In two steps, for a count of 0.
        let value = self.word >> 1 >> (31 - count);
        self.drop(count)?;
        Ok(value)
    }

    /// Ones before a zero, which is taken too; or [`ESCAPE`] of them.
    fn ones(&mut self) -> Result<u32, KeyFrameError> {
        self.fill();
        let ones = self.word.leading_ones().min(ESCAPE);
        self.drop(ones + u32::from(ones < ESCAPE))?;
        Ok(ones)
    }

    /// Whether all was read but the last byte's padding.
    const fn is_done(&self) -> bool {
        self.at == self.bytes.len() && self.held < 8
    }
}

/// Bytes that no image of this size exceeds, whatever is wanted of it.
pub(super) const fn most_bytes(width: usize, height: usize) -> usize {
    let blocks = width.div_ceil(2).saturating_mul(height.div_ceil(2));
    width.saturating_mul(height).saturating_add(blocks.saturating_mul(2)).saturating_mul(2).saturating_add(1)
}

/// Writes the pixels that `pixel` gives (the same at every call), none of them off by more than `error` in Y, Cb or Cr beyond
/// what halving chroma costs.
pub(super) fn encode(
    (width, height): (usize, usize),
    pixel: impl Fn(usize, usize) -> Option<[u8; 3]>,
    error: u8,
    out: &mut [u8],
) -> Result<usize, KeyFrameError> {
    let mut bits = BitWriter { out, at: 0, word: 0, held: 0 };
    let mut luma = Coder::new(error);
    let steps = luma.steps;
    let level = |x: usize, y: usize| pixel(x, y).map(|p| steps.level(ycc(p)[0]));
    for y in 0..height {
        luma.begin_row();
        for x in 0..width {
            if let Some(here) = level(x, y) {
                let up = y.checked_sub(1).and_then(|y| level(x, y));
                luma.write(&mut bits, here, up)?;
            }
        }
    }
    let block = |x: usize, y: usize| {
        let (mut cb, mut cr, mut count) = (0_u32, 0_u32, 0_u32);
        for (x, y) in four(x, y).into_iter().filter(|&(x, y)| x < width && y < height) {
            if let Some(p) = pixel(x, y) {
                let [_, b, r] = ycc(p);
                (cb, cr, count) = (cb + u32::from(b), cr + u32::from(r), count + 1);
            }
        }
        // Divisors that the compiler knows are multiplications.
        let mean = |sum: u32| {
            let mean = match count {
                1 => sum,
                2 => sum.div_ceil(2),
                3 => (sum + 1) / 3,
                _ => (sum + 2) / 4,
            };
            steps.level(mean as u8)
        };
        (count > 0).then(|| (mean(cb), mean(cr)))
    };
    let mut chroma = [Coder::new(error), Coder::new(error)];
    let [blue, red] = &mut chroma;
    for y in 0..height.div_ceil(2) {
        blue.begin_row();
        red.begin_row();
        for x in 0..width.div_ceil(2) {
            if let Some((cb, cr)) = block(x, y) {
                let up = y.checked_sub(1).and_then(|y| block(x, y));
                blue.write(&mut bits, cb, up.map(|u| u.0))?;
                red.write(&mut bits, cr, up.map(|u| u.1))?;
            }
        }
    }
    bits.finish()
}

/// The pixels of a block.
fn four(x: usize, y: usize) -> [(usize, usize); 4] {
    let (x, y) = (2 * x, 2 * y);
    [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)]
}

/// Reads what [`encode`] wrote, into the pixels for which `wanted` says so; the others become 0.
pub(super) fn decode(
    bytes: &[u8],
    wanted: impl Fn(usize, usize) -> bool,
    error: u8,
    out: &mut ImageViewMut<'_, [u8; 3]>,
) -> Result<(), KeyFrameError> {
    let result = read_planes(bytes, &wanted, error, out);
    if result.is_err() {
        out.fill([0; 3]);
    }
    result
}

/// Planes are kept in the output itself: Y in the first channel of its pixel, Cb and Cr in the others of the block's first
/// pixel; the last pass turns them into colours.
fn read_planes(
    bytes: &[u8],
    wanted: &impl Fn(usize, usize) -> bool,
    error: u8,
    out: &mut ImageViewMut<'_, [u8; 3]>,
) -> Result<(), KeyFrameError> {
    let (width, height) = out.size();
    let mut bits = BitReader { bytes, at: 0, word: 0, held: 0 };
    let mut luma = Coder::new(error);
    let steps = luma.steps;
    for y in 0..height {
        luma.begin_row();
        for x in 0..width {
            if wanted(x, y) {
                let up = y.checked_sub(1).filter(|&y| wanted(x, y));
                let up = up.map(|y| steps.level(channel(out.as_view(), x, y, 0)));
                let level = luma.read(&mut bits, up)?;
                out.set(x, y, [steps.value(level), 0, 0]);
            }
        }
    }
    let (columns, rows) = (width.div_ceil(2), height.div_ceil(2));
    let any = |x: usize, y: usize| four(x, y).into_iter().any(|(x, y)| x < width && y < height && wanted(x, y));
    let mut chroma = [Coder::new(error), Coder::new(error)];
    let [blue, red] = &mut chroma;
    for y in 0..rows {
        blue.begin_row();
        red.begin_row();
        for x in 0..columns {
            if any(x, y) {
                let up = y.checked_sub(1).filter(|&y| any(x, y));
                let at = |c| up.map(|y| steps.level(channel(out.as_view(), 2 * x, 2 * y, c)));
                let (up_blue, up_red) = (at(1), at(2));
                let cb = steps.value(blue.read(&mut bits, up_blue)?);
                let cr = steps.value(red.read(&mut bits, up_red)?);
                if let Some(pixel) = out.row_mut(2 * y).get_mut(2 * x) {
                    let [luma, ..] = *pixel;
                    *pixel = [luma, cb, cr];
                }
            }
        }
    }
    if !bits.is_done() {
        return Err(KeyFrameError::Colour);
    }
    for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
        let [_, cb, cr] = out.as_view().get(2 * x, 2 * y).unwrap_or_default();
        for (x, y) in four(x, y) {
            if let Some(pixel) = out.row_mut(y).get_mut(x) {
                let [luma, ..] = *pixel;
                *pixel = if wanted(x, y) { rgb([luma, cb, cr]) } else { [0; 3] };
            }
        }
    }
    Ok(())
}

fn channel(view: ImageView<'_, [u8; 3]>, x: usize, y: usize, channel: usize) -> u8 {
    view.get(x, y).and_then(|p| p.get(channel).copied()).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec;

    #[test]
    fn the_colour_transform_returns_colours_within_two() {
        for r in (0..=255).step_by(5) {
            for g in (0..=255).step_by(5) {
                for b in (0..=255).step_by(3) {
                    let back = rgb(ycc([r, g, b]));
                    let off = [r.abs_diff(back[0]), g.abs_diff(back[1]), b.abs_diff(back[2])];
                    assert!(off.iter().all(|o| *o <= 2), "{r} {g} {b}: {back:?}");
                }
            }
        }
        // Greys are exact.
        assert!((0..=255).all(|v| rgb(ycc([v; 3])) == [v; 3]));
    }

    #[test]
    fn rounding_keeps_its_word() {
        for error in 0..=15 {
            let steps = Steps::new(error);
            assert!(steps.levels <= 256);
            for v in 0..=255_u8 {
                let level = steps.level(v);
                assert!((0..steps.levels).contains(&level));
                assert!(steps.value(level).abs_diff(v) <= error);
                assert_eq!(steps.level(steps.value(level)), level, "what the decoder sees is what was meant");
            }
        }
    }

    proptest! {
        #[test]
        fn planes_come_back_within_the_error(
            width in 1_usize..18, height in 1_usize..14, error in 0_u8..8, hole in 0_u32..8, seed in any::<u32>(),
            noise in 0_u32..256,
        ) {
            let mut s = seed | 1;
            let mut next = || { s ^= s << 13; s ^= s >> 17; s ^= s << 5; s >> 8 };
            let image: vec::Vec<Option<[u8; 3]>> = (0..width * height)
                .map(|i| {
                    // Grey, so that halving chroma loses nothing: what is left is the rounding.
                    let v = (i as u32 * 3 + next() % (noise + 1)) as u8;
                    (next() % 8 >= hole).then_some([v; 3])
                })
                .collect();
            let pixel = |x: usize, y: usize| image[y * width + x];
            let mut bytes = vec![0; most_bytes(width, height)];
            let used = encode((width, height), pixel, error, &mut bytes).unwrap();
            let mut back = vec![[9; 3]; width * height];
            let wanted = |x: usize, y: usize| pixel(x, y).is_some();
            let mut view = ImageViewMut::new(&mut back, width, height).unwrap();
            decode(&bytes[..used], wanted, error, &mut view).unwrap();
            let most = u32::from(error);
            for (got, want) in back.iter().zip(&image) {
                match want {
                    Some(want) => prop_assert!(u32::from(got[0].abs_diff(want[0])) <= most && got[0] == got[1] && got[1] == got[2]),
                    None => prop_assert_eq!(got, &[0; 3]),
                }
            }
            // Cut off, it is refused, and nothing half-read is left.
            if used > 0 {
                let mut view = ImageViewMut::new(&mut back, width, height).unwrap();
                prop_assert!(decode(&bytes[..used - 1], wanted, error, &mut view).is_err());
                prop_assert!(back.iter().all(|p| *p == [0; 3]));
            }
        }
    }
}
