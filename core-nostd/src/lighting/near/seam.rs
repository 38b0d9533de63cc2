//! Coverage that fades towards its border, so that the seam between near and far does not show.
//!
//! Coverage becomes the distance to the nearest uncovered pixel along rows and columns (chamfer distance, two passes in place), in parts of the seam's width.

use crate::ground::lanes::LANES;

/// Fades coverage over `seam` pixels within the rows `rows` of a picture, around which there is none; columns close to a ring, and beyond the
/// poles there is nothing to fade towards.
pub(super) fn fade(picture: &mut [[u8; 4]], width: usize, rows: (usize, usize), seam: u8) {
    if seam == 0 || width == 0 {
        return;
    }
    let step = (255 / u16::from(seam)).max(1) as u8;
    let height = picture.len() / width;
    let pixels = picture.get_mut(rows.0 * width..rows.1 * width).unwrap_or_default();
    let n = pixels.len() / width;
    for y in 0..n {
        let Some((above, row)) = pixels.split_at_mut_checked(y * width) else { return };
        let above = above.get(y.saturating_sub(1) * width..).unwrap_or_default();
        let row = row.get_mut(..width).unwrap_or_default();
        if y > 0 {
            across(row, above, step);
        } else if rows.0 > 0 {
            border(row, step);
        }
        along(row, step, seam);
    }
    for y in (0..n).rev() {
        let Some((rest, below)) = pixels.split_at_mut_checked((y + 1) * width) else { return };
        let row = rest.get_mut(y * width..).unwrap_or_default();
        if y + 1 < n {
            across(row, below, step);
        } else if rows.1 < height {
            border(row, step);
        }
    }
}

/// No more than one step above the row beside.
fn across(row: &mut [[u8; 4]], beside: &[[u8; 4]], step: u8) {
    // Four bytes as one number: coverage is its upper byte, and compares as it does.
    for (p, b) in row.iter_mut().zip(beside) {
        let (own, other) = (u32::from_le_bytes(*p), u32::from_le_bytes(*b) >> 24);
        let most = (other + u32::from(step)).min(255);
        let cover = (own >> 24).min(most);
        *p = (own & 0x00ff_ffff | cover << 24).to_le_bytes();
    }
}

/// Beside a row without coverage.
fn border(row: &mut [[u8; 4]], step: u8) {
    for [.., cover] in row {
        *cover = (*cover).min(step);
    }
}

/// Along a row, both ways, around the ring.
fn along(row: &mut [[u8; 4]], step: u8, seam: u8) {
    // A row that is all or nothing has no border in it.
    let first = row.first().map_or(0, |p| p[3]);
    if row.iter().all(|p| p[3] == first) {
        return;
    }
    let turn = usize::from(seam).min(row.len());
    let (mut held, last) = (row.last().map_or(0, |p| p[3]), row.len().saturating_sub(turn));
    row.chunks_mut(LANES).for_each(|eight| held = one_way(eight, false, held, step));
    one_way(row.get_mut(..turn).unwrap_or_default(), false, held, step);
    let mut held = row.first().map_or(0, |p| p[3]);
    row.rchunks_mut(LANES).for_each(|eight| held = one_way(eight, true, held, step));
    one_way(row.get_mut(last..).unwrap_or_default(), true, held, step);
}

/// No more than one step above the pixel before, of which the first's is `held`; the last one's coverage. Pixels without a border among them are
/// passed over at once.
#[inline(always)]
fn one_way(pixels: &mut [[u8; 4]], backwards: bool, held: u8, step: u8) -> u8 {
    let (all, any) = pixels.iter().fold((255, 0), |(all, any), p| (all & p[3], any | p[3]));
    if any == 0 || held == 255 && all == 255 {
        return if any == 0 && !pixels.is_empty() { 0 } else { held };
    }
    let next = |held: u8, [.., cover]: &mut [u8; 4]| {
        *cover = (*cover).min(held.saturating_add(step));
        *cover
    };
    if backwards { pixels.iter_mut().rev().fold(held, next) } else { pixels.iter_mut().fold(held, next) }
}
