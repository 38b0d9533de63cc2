//! How much of everything: views, sizes, levels. Four presets, or your own.
//!
//! | preset | views | view | levels | map | memory of the near field |
//! |---|--:|---|---|---|--:|
//! | [`Preset::TINY`] (ours) | 1 | 96 x 72 | 96 x 48, 48 x 24 | 96 x 48 | 72 KiB |
//! | [`Preset::LOW`] | 3 | 256 x 192 | 512 x 256, 256 x 128, 64 x 32 | 512 x 256 | 2.8 MiB |
//! | [`Preset::MEDIUM`] | 4 | 512 x 384 | 768 x 384, 384 x 192 | 512 x 256 | 9.5 MiB |
//! | [`Preset::HIGH`] | 5 | 1024 x 768 | 1024 x 512, 512 x 256 | 1024 x 512 | 31 MiB |

use core::fmt;

/// Views that a near field has at most.
pub const MOST_VIEWS: usize = 8;
/// Levels that a projection has at most.
pub const MOST_LEVELS: usize = 4;

/// Sizes of one session. Check with [`Preset::check`], or let the near field do so.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Preset {
    /// Views kept: 1 to 8.
    pub views: usize,
    /// Width and height of a view; larger frames are brought down to it.
    pub view: (usize, usize),
    /// Widths of the projection's levels, finest first, each as high as half its width and dividing the one before; 0 after the last.
    pub levels: [usize; MOST_LEVELS],
    /// Width and height of the environment map.
    pub map: (usize, usize),
}

/// Why a preset can't be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PresetError {
    /// Not 1 to [`MOST_VIEWS`] views.
    Views(usize),
    /// A view has no pixels, or more than 2^20.
    View((usize, usize)),
    /// A level's width is odd or 0, does not divide the one before, or is above 8192.
    Level {
        /// Which, from 0.
        index: usize,
        /// Its width.
        width: usize,
    },
    /// The map has no pixels, or more than 8192 a side.
    Map((usize, usize)),
}

impl fmt::Display for PresetError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Views(n) => write!(f, "{n} views; a near field keeps 1 to {MOST_VIEWS}"),
            Self::View((w, h)) => write!(f, "views of {w}x{h}; they have at least a pixel and at most 1048576"),
            Self::Level { index, width } => write!(
                f,
                "projection level {index} is {width} wide; levels are even, at most 8192 wide, and each divides the one before"
            ),
            Self::Map((w, h)) => write!(f, "a map of {w}x{h}; give 1 to 8192 pixels a side"),
        }
    }
}

impl core::error::Error for PresetError {}

impl Preset {
    /// Ours, for devices: with everything else it fits 256 KiB.
    pub const TINY: Self = Self { views: 1, view: (96, 72), levels: [96, 48, 0, 0], map: (96, 48) };
    /// The paper's low quality.
    pub const LOW: Self = Self { views: 3, view: (256, 192), levels: [512, 256, 64, 0], map: (512, 256) };
    /// The paper's medium quality.
    pub const MEDIUM: Self = Self { views: 4, view: (512, 384), levels: [768, 384, 0, 0], map: (512, 256) };
    /// The paper's high quality.
    pub const HIGH: Self = Self { views: 5, view: (1024, 768), levels: [1024, 512, 0, 0], map: (1024, 512) };

    /// Pixels of a view.
    #[must_use]
    pub const fn view_pixels(&self) -> usize {
        self.view.0.saturating_mul(self.view.1)
    }

    /// Width and height of the finest level.
    #[must_use]
    pub const fn finest(&self) -> (usize, usize) {
        let [width, ..] = self.levels;
        (width, width / 2)
    }

    /// Pixels of the finest level.
    #[must_use]
    pub const fn level_pixels(&self) -> usize {
        let (width, height) = self.finest();
        width.saturating_mul(height)
    }

    /// Pixels of the map.
    #[must_use]
    pub const fn map_pixels(&self) -> usize {
        self.map.0.saturating_mul(self.map.1)
    }

    /// Elements of scratch for merging: a strip as high as the coarsest level's pixel, of all levels, two for each pixel.
    #[must_use]
    pub const fn strip(&self) -> usize {
        let [finest, second, third, fourth] = self.levels;
        let coarsest = if fourth > 0 {
            fourth
        } else if third > 0 {
            third
        } else if second > 0 {
            second
        } else {
            finest
        };
        if coarsest == 0 {
            return 0;
        }
        // Width times rows in the strip, level by level.
        2 * (finest * (finest / coarsest)
            + second * (second / coarsest)
            + third * (third / coarsest)
            + fourth * (fourth / coarsest))
    }

    /// Whether the sizes fit together.
    ///
    /// # Errors
    /// [`PresetError`] names what does not.
    pub const fn check(&self) -> Result<(), PresetError> {
        if self.views == 0 || self.views > MOST_VIEWS {
            return Err(PresetError::Views(self.views));
        }
        if self.view_pixels() == 0 || self.view_pixels() > 1 << 20 {
            return Err(PresetError::View(self.view));
        }
        let [a, b, c, d] = self.levels;
        if a == 0 || a % 2 == 1 || a > 8192 {
            return Err(PresetError::Level { index: 0, width: a });
        }
        if b > 0 && (b % 2 == 1 || a % b != 0) {
            return Err(PresetError::Level { index: 1, width: b });
        }
        if c > 0 && (b == 0 || c % 2 == 1 || b % c != 0) {
            return Err(PresetError::Level { index: 2, width: c });
        }
        if d > 0 && (c == 0 || d % 2 == 1 || c % d != 0) {
            return Err(PresetError::Level { index: 3, width: d });
        }
        let (w, h) = self.map;
        if w == 0 || h == 0 || w > 8192 || h > 8192 {
            return Err(PresetError::Map(self.map));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_fit_and_what_does_not_is_named() {
        for p in [Preset::TINY, Preset::LOW, Preset::MEDIUM, Preset::HIGH] {
            p.check().unwrap();
        }
        assert_eq!(Preset::LOW.strip(), 2 * (512 * 8 + 256 * 4 + 64));
        assert_eq!(Preset { views: 9, ..Preset::LOW }.check(), Err(PresetError::Views(9)));
        assert_eq!(Preset { view: (2048, 1024), ..Preset::LOW }.check(), Err(PresetError::View((2048, 1024))));
        let bad = [[0, 0, 0, 0], [512, 300, 0, 0], [512, 0, 64, 0], [511, 0, 0, 0], [usize::MAX - 1, 2, 0, 0]];
        for levels in bad {
            assert!(matches!(Preset { levels, ..Preset::LOW }.check(), Err(PresetError::Level { .. })), "{levels:?}");
        }
        assert_eq!(Preset { map: (0, 9), ..Preset::LOW }.check(), Err(PresetError::Map((0, 9))));
        assert!(std::format!("{}", PresetError::Level { index: 1, width: 300 }).contains("level 1 is 300 wide"));
    }
}
