//! Coverage that fades towards its border, so that the seam between near and far does not show.
//!
//! Coverage becomes the distance to the nearest uncovered pixel along rows and columns (chamfer distance, two passes in place), in parts of the seam's width.

/// Fades coverage over `seam` pixels within the rows `rows` of a picture; columns close to a ring.
pub(super) fn fade(picture: &mut [[u8; 4]], width: usize, rows: (usize, usize), seam: u8) {
    if seam == 0 || width == 0 {
        return;
    }
    let step = (255 / u16::from(seam)).max(1) as u8;
    let pixels = picture.get_mut(rows.0 * width..rows.1 * width).unwrap_or_default();
    let n = pixels.len() / width;
    // Beyond the first and the last row there is nothing, unless they are the poles.
    let whole = rows.0 == 0;
    for y in 0..n {
        let (above, row) = pixels.split_at_mut(y * width);
        let above = above.get(y.saturating_sub(1) * width..).unwrap_or_default();
        let row = row.get_mut(..width).unwrap_or_default();
        if y > 0 {
            for (p, a) in row.iter_mut().zip(above) {
                p[3] = p[3].min(a[3].saturating_add(step));
            }
        } else if !whole {
            for p in row.iter_mut() {
                p[3] = p[3].min(step);
            }
        }
        along(row, step, seam);
    }
    for y in (0..n.saturating_sub(1)).rev() {
        let (rest, below) = pixels.split_at_mut((y + 1) * width);
        let row = rest.get_mut(y * width..).unwrap_or_default();
        for (p, b) in row.iter_mut().zip(below.iter()) {
            p[3] = p[3].min(b[3].saturating_add(step));
        }
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
    let mut held = row.last().map_or(0, |p| p[3]);
    let mut pass = |p: &mut [u8; 4]| {
        held = p[3].min(held.saturating_add(step));
        p[3] = held;
    };
    row.iter_mut().for_each(&mut pass);
    row.iter_mut().take(turn).for_each(&mut pass);
    let mut held = row.first().map_or(0, |p| p[3]);
    let mut pass = |p: &mut [u8; 4]| {
        held = p[3].min(held.saturating_add(step));
        p[3] = held;
    };
    row.iter_mut().rev().for_each(&mut pass);
    row.iter_mut().rev().take(turn).for_each(&mut pass);
}
