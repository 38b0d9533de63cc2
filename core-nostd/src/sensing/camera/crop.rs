//! How the pixels of a colour image and of its depth image correspond when depth is a scaled crop of colour's middle.
//!
//! Phones give 4:3 or 16:9 colour with depth of another aspect; the depth image then covers the middle of the colour
//! image. s is the scale at which the colour image just covers the depth image, `x_d + 1/2 = s (x_c + 1/2) - (s W_c - W_d) / 2`,
//! y alike. (The half pixels belong to our convention of centres at integers; the API page leaves them out.) A colour
//! pixel outside the crop has no depth: the answer is `None`, never a clamped neighbour.

use glam::Vec2;

use crate::sensing::camera::intrinsics::{Intrinsics, IntrinsicsError};

/// The map between a colour image and the depth image that covers its middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CropMap {
    scale: f32,
    offset: Vec2,
    colour: (usize, usize),
    depth: (usize, usize),
}

impl CropMap {
    /// From both sizes (width, height); `None` when one of them is empty.
    ///
    /// ```
    /// use glam::vec2;
    /// use isobath::sensing::camera::crop::CropMap;
    /// // 640x480 colour, 160x90 depth: the depth image covers rows 60 to 420.
    /// let map = CropMap::centred((640, 480), (160, 90)).unwrap();
    /// assert_eq!(map.depth_from_colour(vec2(0.0, 50.0)), None);
    /// let p = map.depth_from_colour(vec2(319.5, 239.5)).unwrap();
    /// assert_eq!(p, vec2(79.5, 44.5));
    /// assert_eq!(map.colour_from_depth(p), Some(vec2(319.5, 239.5)));
    /// ```
    #[must_use]
    pub fn centred(colour: (usize, usize), depth: (usize, usize)) -> Option<Self> {
        if colour.0 == 0 || colour.1 == 0 || depth.0 == 0 || depth.1 == 0 {
            return None;
        }
        let c = Vec2::new(colour.0 as f32, colour.1 as f32);
        let d = Vec2::new(depth.0 as f32, depth.1 as f32);
        let scale = (d / c).max_element();
        let offset = 0.5 * (d - scale * c) + 0.5 * scale - 0.5;
        Some(Self { scale, offset, colour, depth })
    }

    /// Depth pixels per colour pixel.
    #[must_use]
    pub const fn scale(&self) -> f32 {
        self.scale
    }

    /// The depth pixel (fractional) behind a colour pixel; `None` when it lies outside either image.
    #[must_use]
    pub fn depth_from_colour(&self, pixel: Vec2) -> Option<Vec2> {
        let p = self.depth_coordinates(pixel);
        (inside(pixel, self.colour) && inside(p, self.depth)).then_some(p)
    }

    /// Where a colour pixel (fractional) lies in the depth image's coordinates, also outside of it: for rays, which go on there.
    #[must_use]
    pub fn depth_coordinates(&self, pixel: Vec2) -> Vec2 {
        pixel * self.scale + self.offset
    }

    /// The colour pixel (fractional) before a depth pixel; `None` when it lies outside either image.
    #[must_use]
    pub fn colour_from_depth(&self, pixel: Vec2) -> Option<Vec2> {
        let p = (pixel - self.offset) / self.scale;
        (inside(pixel, self.depth) && inside(p, self.colour)).then_some(p)
    }

    /// The colour image's intrinsics from the depth image's.
    ///
    /// # Errors
    /// [`IntrinsicsError`] when the scale takes them out of bounds.
    pub fn colour_intrinsics(&self, depth: &Intrinsics) -> Result<Intrinsics, IntrinsicsError> {
        let back = 1.0 / self.scale;
        Intrinsics::new(
            depth.fx() * back,
            depth.fy() * back,
            (depth.cx() - self.offset.x) * back,
            (depth.cy() - self.offset.y) * back,
        )
    }

    /// The depth image's intrinsics from the colour image's.
    ///
    /// # Errors
    /// [`IntrinsicsError`] when the scale takes them out of bounds.
    pub fn depth_intrinsics(&self, colour: &Intrinsics) -> Result<Intrinsics, IntrinsicsError> {
        Intrinsics::new(
            colour.fx() * self.scale,
            colour.fy() * self.scale,
            colour.cx() * self.scale + self.offset.x,
            colour.cy() * self.scale + self.offset.y,
        )
    }
}

/// Within the squares of the image's pixels (a hair wider, so that the outer edge survives rounding).
fn inside(p: Vec2, size: (usize, usize)) -> bool {
    let slack = 0.5 + 1e-3;
    p.x >= -slack && p.y >= -slack && p.x <= size.0 as f32 - 1.0 + slack && p.y <= size.1 as f32 - 1.0 + slack
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::vec2;

    #[test]
    fn equal_sizes_are_the_identity() {
        let map = CropMap::centred((741, 500), (741, 500)).unwrap();
        assert_eq!(map.depth_from_colour(vec2(740.0, 0.0)), Some(vec2(740.0, 0.0)));
    }

    #[test]
    fn a_world_point_projects_to_corresponding_pixels() {
        for (colour, depth) in [((1920, 1080), (160, 120)), ((640, 480), (160, 90)), ((1440, 1080), (240, 180))] {
            let map = CropMap::centred(colour, depth).unwrap();
            let kc = Intrinsics::new(1100.0, 1090.0, colour.0 as f32 * 0.51, colour.1 as f32 * 0.48).unwrap();
            let kd = map.depth_intrinsics(&kc).unwrap();
            let p = glam::Vec3::new(0.1, -0.05, 1.3);
            let (c, d) = (kc.project(p).unwrap(), kd.project(p).unwrap());
            assert!((map.depth_from_colour(c).unwrap() - d).length() < 1e-3);
            assert!((map.colour_from_depth(d).unwrap() - c).length() < 1e-2);
            let again = map.colour_intrinsics(&kd).unwrap();
            assert!((again.project(p).unwrap() - c).length() < 1e-2);
        }
    }

    #[test]
    fn outside_the_crop_there_is_no_depth() {
        // Wide colour, 4:3 depth: the left and right of the colour image have none.
        let map = CropMap::centred((1920, 1080), (160, 120)).unwrap();
        assert_eq!(map.depth_from_colour(vec2(100.0, 500.0)), None);
        assert_eq!(map.depth_from_colour(vec2(1900.0, 500.0)), None);
        assert_eq!(map.depth_from_colour(vec2(f32::NAN, 0.0)), None);
        assert!(CropMap::centred((0, 10), (10, 10)).is_none());
    }
}
