//! Where a touch on the screen lands in the image, however the phone is held.
//!
//! The sensor's image is landscape. The screen shows it turned by the device's orientation, and scaled to fill (cropping
//! the longer side) or to fit (with bars). Screen and image coordinates are uv: [0, 1], origin top left of the screen as
//! held, and of the image as the sensor gives it.
//!
//! | orientation | how the image is turned for display |
//! |---|---|
//! | landscape left | not at all (the device is turned counter-clockwise from portrait) |
//! | portrait | 90 degrees clockwise |
//! | landscape right | 180 degrees |
//! | portrait upside down | 90 degrees counter-clockwise |

use glam::Vec2;

/// How the device is held.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum ScreenOrientation {
    /// Upright.
    Portrait,
    /// Upright, top down.
    PortraitUpsideDown,
    /// Turned counter-clockwise from portrait: the sensor image is upright.
    #[default]
    LandscapeLeft,
    /// Turned clockwise from portrait: the sensor image is upside down.
    LandscapeRight,
}

impl ScreenOrientation {
    /// Whether screen x runs along the image's y.
    #[must_use]
    pub const fn swaps_axes(self) -> bool {
        matches!(self, Self::Portrait | Self::PortraitUpsideDown)
    }

    /// Image uv of the point that is shown at `screen` uv, when the image exactly covers the screen.
    #[must_use]
    pub fn image_uv(self, screen: Vec2) -> Vec2 {
        let Vec2 { x, y } = screen;
        match self {
            Self::LandscapeLeft => Vec2::new(x, y),
            Self::LandscapeRight => Vec2::new(1.0 - x, 1.0 - y),
            Self::Portrait => Vec2::new(y, 1.0 - x),
            Self::PortraitUpsideDown => Vec2::new(1.0 - y, x),
        }
    }

    /// The inverse of [`Self::image_uv`].
    #[must_use]
    pub fn screen_uv(self, image: Vec2) -> Vec2 {
        let Vec2 { x, y } = image;
        match self {
            Self::LandscapeLeft => Vec2::new(x, y),
            Self::LandscapeRight => Vec2::new(1.0 - x, 1.0 - y),
            Self::Portrait => Vec2::new(1.0 - y, x),
            Self::PortraitUpsideDown => Vec2::new(y, 1.0 - x),
        }
    }
}

/// How an image of one aspect is shown on a screen of another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum ScreenFit {
    /// The image covers the screen; what sticks out is not shown (camera backgrounds).
    #[default]
    Fill,
    /// The whole image is shown; the rest of the screen is empty.
    Fit,
    /// Each axis is scaled on its own.
    Stretch,
}

/// The map between screen and image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScreenMap {
    orientation: ScreenOrientation,
    /// Screen uv around the centre times this gives the turned image's uv around the centre.
    scale: Vec2,
}

impl ScreenMap {
    /// From the screen's size as held, and the image's as the sensor gives it (any units); `None` when one is empty.
    ///
    /// ```
    /// use glam::vec2;
    /// use isobath::sensing::camera::screen::{ScreenFit, ScreenMap, ScreenOrientation};
    /// let map = ScreenMap::new(ScreenOrientation::Portrait, (1080, 1440), (640, 480), ScreenFit::Fill).unwrap();
    /// // The top left of an upright phone is the bottom left of the sensor's image.
    /// assert_eq!(map.image_uv(vec2(0.0, 0.0)), Some(vec2(0.0, 1.0)));
    /// ```
    #[must_use]
    pub fn new(
        orientation: ScreenOrientation,
        screen: (usize, usize),
        image: (usize, usize),
        fit: ScreenFit,
    ) -> Option<Self> {
        let turned = if orientation.swaps_axes() { (image.1, image.0) } else { image };
        if screen.0 == 0 || screen.1 == 0 || turned.0 == 0 || turned.1 == 0 {
            return None;
        }
        // Screen lengths per image length, on either axis.
        let per_image = Vec2::new(screen.0 as f32 / turned.0 as f32, screen.1 as f32 / turned.1 as f32);
        let scale = match fit {
            ScreenFit::Fill => per_image / per_image.max_element(),
            ScreenFit::Fit => per_image / per_image.min_element(),
            ScreenFit::Stretch => Vec2::ONE,
        };
        Some(Self { orientation, scale })
    }

    /// The image point shown at a screen point; `None` outside the screen or where no image is shown.
    #[must_use]
    pub fn image_uv(&self, screen: Vec2) -> Option<Vec2> {
        let image = self.orientation.image_uv((screen - 0.5) * self.scale + 0.5);
        (unit(screen) && unit(image)).then_some(image)
    }

    /// The screen point that shows an image point; `None` when it is cropped away or outside the image.
    #[must_use]
    pub fn screen_uv(&self, image: Vec2) -> Option<Vec2> {
        let screen = (self.orientation.screen_uv(image) - 0.5) / self.scale + 0.5;
        (unit(screen) && unit(image)).then_some(screen)
    }
}

/// In [0, 1] on both axes, a rounding error allowed.
fn unit(p: Vec2) -> bool {
    let e = 1e-6;
    p.x >= -e && p.y >= -e && p.x <= 1.0 + e && p.y <= 1.0 + e
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::vec2;
    use proptest::prelude::*;

    const ALL: [ScreenOrientation; 4] = [
        ScreenOrientation::Portrait,
        ScreenOrientation::PortraitUpsideDown,
        ScreenOrientation::LandscapeLeft,
        ScreenOrientation::LandscapeRight,
    ];

    #[test]
    fn turning_is_a_rotation_not_a_mirror() {
        for o in ALL {
            let x = o.image_uv(vec2(1.0, 0.5)) - o.image_uv(vec2(0.0, 0.5));
            let y = o.image_uv(vec2(0.5, 1.0)) - o.image_uv(vec2(0.5, 0.0));
            assert_eq!(x.perp_dot(y), 1.0, "{o:?}");
        }
    }

    #[test]
    fn portrait_shows_image_top_on_the_right() {
        // Turned 90 degrees clockwise, the image's top left corner is at the screen's top right.
        assert_eq!(ScreenOrientation::Portrait.screen_uv(vec2(0.0, 0.0)), vec2(1.0, 0.0));
        assert_eq!(ScreenOrientation::PortraitUpsideDown.screen_uv(vec2(0.0, 0.0)), vec2(0.0, 1.0));
    }

    #[test]
    fn bars_hold_no_image() {
        let map = ScreenMap::new(ScreenOrientation::LandscapeLeft, (200, 100), (100, 100), ScreenFit::Fit).unwrap();
        assert_eq!(map.image_uv(vec2(0.2, 0.5)), None);
        assert_eq!(map.image_uv(vec2(0.25, 0.5)), Some(vec2(0.0, 0.5)));
        let fill = ScreenMap::new(ScreenOrientation::LandscapeLeft, (200, 100), (100, 100), ScreenFit::Fill).unwrap();
        assert_eq!(fill.image_uv(vec2(0.5, 0.0)), Some(vec2(0.5, 0.25)));
        assert_eq!(fill.screen_uv(vec2(0.5, 0.1)), None);
        assert_eq!(fill.image_uv(vec2(f32::NAN, 0.0)), None);
        assert!(ScreenMap::new(ScreenOrientation::Portrait, (0, 1), (1, 1), ScreenFit::Fill).is_none());
    }

    proptest! {
        #[test]
        fn there_and_back(o in 0_usize..4, sw in 1_usize..3000, sh in 1_usize..3000, x in 0.0_f32..1.0, y in 0.0_f32..1.0) {
            for fit in [ScreenFit::Fill, ScreenFit::Fit, ScreenFit::Stretch] {
                let map = ScreenMap::new(ALL[o], (sw, sh), (640, 480), fit).unwrap();
                if let Some(image) = map.image_uv(vec2(x, y)) {
                    let back = map.screen_uv(image).unwrap();
                    // Extreme aspects shrink one axis; its rounding grows by the inverse.
                    prop_assert!((back - vec2(x, y)).length() < 1e-6 / map.scale.min_element().min(1.0) + 1e-5);
                }
            }
        }
    }
}
