//! The memory of a near field, as host tests want it: as much as a preset needs.

use isobath::lighting::Preset;
use isobath::lighting::near::NearMemory;

/// Owns what [`NearMemory`] lends.
#[derive(Debug)]
pub struct NearBox {
    depth: Vec<u16>,
    colour: Vec<[u8; 3]>,
    layers: Vec<u32>,
    picture: Vec<[u8; 4]>,
    strip: Vec<u32>,
}

impl NearBox {
    /// As much as the preset needs, also of one that is refused.
    #[must_use]
    pub fn new(preset: &Preset) -> Self {
        let (points, cells) = (preset.views * preset.view_pixels(), preset.level_pixels());
        Self {
            depth: vec![0; points],
            colour: vec![[0; 3]; points],
            layers: vec![0; preset.views * cells],
            picture: vec![[0; 4]; cells],
            strip: vec![0; preset.strip()],
        }
    }

    /// Lent to a near field.
    pub fn lend(&mut self) -> NearMemory<'_> {
        let Self { depth, colour, layers, picture, strip } = self;
        NearMemory { depth, colour, layers, picture, strip }
    }
}
