//! Images: fixed storage that can live in a `static`, and views of any memory.
//!
//! [`Image<T, W, H>`] owns `W * H * size_of::<T>()` bytes and nothing else. [`ImageView`] and [`ImageViewMut`] borrow a
//! slice with a width, a height and a stride (elements from one row's start to the next), so the same code serves a
//! 160 x 120 static, a camera's padded buffer and a 1024 x 768 `Vec`. Rows run top to bottom, pixels left to right.
//! An image of no pixels is legal and empty. No accessor panics: outside the image there is no pixel (`None`) and no row
//! (an empty slice).

use core::fmt;

/// Why a slice can't be seen as an image of the asked shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ImageError {
    /// The stride is smaller than the width, so rows would overlap.
    StrideBelowWidth {
        /// Elements from one row's start to the next.
        stride: usize,
        /// Elements in a row.
        width: usize,
    },
    /// The slice ends before the last row does.
    TooShort {
        /// Elements needed: `(height - 1) * stride + width`; `usize::MAX` when that does not fit in a `usize`.
        needed: usize,
        /// Elements in the slice.
        got: usize,
    },
}

impl fmt::Display for ImageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::StrideBelowWidth { stride, width } => write!(
                f,
                "row stride {stride} is smaller than the width {width}: rows would overlap; give the stride in elements, not bytes"
            ),
            Self::TooShort { needed, got } => {
                write!(f, "the image needs {needed} elements, the slice has {got}")
            }
        }
    }
}

impl core::error::Error for ImageError {}

/// Checks the shape; on success returns nothing, and every row slice below is in range.
const fn check(len: usize, width: usize, height: usize, stride: usize) -> Result<(), ImageError> {
    if stride < width {
        return Err(ImageError::StrideBelowWidth { stride, width });
    }
    if width == 0 || height == 0 {
        return Ok(());
    }
    let needed = match (height - 1).checked_mul(stride) {
        Some(n) => n.saturating_add(width),
        None => usize::MAX,
    };
    if len < needed {
        return Err(ImageError::TooShort { needed, got: len });
    }
    Ok(())
}

/// A read-only view of pixels in borrowed memory.
///
/// ```
/// use isobath::ground::image::ImageView;
/// let padded = [1_u16, 2, 0, 3, 4, 0]; // two pixels a row, one of padding
/// let view = ImageView::with_stride(&padded, 2, 2, 3)?;
/// assert_eq!(view.get(1, 1), Some(4));
/// assert_eq!(view.get(2, 1), None);
/// assert_eq!(view.row(0), &[1, 2]);
/// # Ok::<(), isobath::ground::image::ImageError>(())
/// ```
#[derive(Debug, Clone, Copy)]
pub struct ImageView<'a, T> {
    data: &'a [T],
    width: usize,
    height: usize,
    stride: usize,
}

impl<'a, T> ImageView<'a, T> {
    /// An image of no pixels.
    pub const EMPTY: Self = Self { data: &[], width: 0, height: 0, stride: 0 };

    /// A view of tightly packed rows.
    ///
    /// # Errors
    /// [`ImageError::TooShort`] when `data` holds fewer than `width * height` elements.
    pub const fn new(data: &'a [T], width: usize, height: usize) -> Result<Self, ImageError> {
        Self::with_stride(data, width, height, width)
    }

    /// A view of rows that start `stride` elements apart.
    ///
    /// # Errors
    /// [`ImageError`] when the stride is below the width or the slice too short.
    pub const fn with_stride(data: &'a [T], width: usize, height: usize, stride: usize) -> Result<Self, ImageError> {
        match check(data.len(), width, height, stride) {
            Ok(()) => Ok(Self { data, width, height, stride }),
            Err(e) => Err(e),
        }
    }

    /// Pixels in a row.
    #[must_use]
    pub const fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    #[must_use]
    pub const fn height(&self) -> usize {
        self.height
    }

    /// Width and height.
    #[must_use]
    pub const fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Elements from one row's start to the next.
    #[must_use]
    pub const fn stride(&self) -> usize {
        self.stride
    }

    /// Whether there are no pixels.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.width == 0 || self.height == 0
    }

    /// Row `y`, `width` pixels long; empty when `y` is outside.
    #[inline]
    #[must_use]
    pub fn row(&self, y: usize) -> &'a [T] {
        if y >= self.height {
            return &[];
        }
        let start = y.saturating_mul(self.stride);
        self.data.get(start..).and_then(|rest| rest.get(..self.width)).unwrap_or(&[])
    }

    /// The rows from top to bottom.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &'a [T]> + use<'a, T> {
        let view = Self { data: self.data, width: self.width, height: self.height, stride: self.stride };
        (0..self.height).map(move |y| view.row(y))
    }

    /// The part of the view that starts at `(x, y)` and is at most `width` by `height`; what falls outside is cut off.
    #[must_use]
    pub fn crop(&self, x: usize, y: usize, width: usize, height: usize) -> Self {
        let width = width.min(self.width.saturating_sub(x));
        let height = height.min(self.height.saturating_sub(y));
        if width == 0 || height == 0 {
            return Self::EMPTY;
        }
        let start = y.saturating_mul(self.stride).saturating_add(x);
        Self { data: self.data.get(start..).unwrap_or(&[]), width, height, stride: self.stride }
    }
}

impl<T: Copy> ImageView<'_, T> {
    /// The pixel in column `x` and row `y`; `None` outside.
    #[inline]
    #[must_use]
    pub fn get(&self, x: usize, y: usize) -> Option<T> {
        if x >= self.width || y >= self.height {
            return None;
        }
        self.data.get(y * self.stride + x).copied()
    }

    /// As [`Self::get`], for signed coordinates.
    #[inline]
    #[must_use]
    pub fn get_signed(&self, x: i32, y: i32) -> Option<T> {
        self.get(usize::try_from(x).ok()?, usize::try_from(y).ok()?)
    }
}

/// A writable view of pixels in borrowed memory. As [`ImageView`], but exclusive.
#[derive(Debug)]
pub struct ImageViewMut<'a, T> {
    data: &'a mut [T],
    width: usize,
    height: usize,
    stride: usize,
}

impl<'a, T> ImageViewMut<'a, T> {
    /// A view of tightly packed rows.
    ///
    /// # Errors
    /// [`ImageError::TooShort`] when `data` holds fewer than `width * height` elements.
    pub const fn new(data: &'a mut [T], width: usize, height: usize) -> Result<Self, ImageError> {
        Self::with_stride(data, width, height, width)
    }

    /// A view of rows that start `stride` elements apart.
    ///
    /// # Errors
    /// [`ImageError`] when the stride is below the width or the slice too short.
    pub const fn with_stride(
        data: &'a mut [T],
        width: usize,
        height: usize,
        stride: usize,
    ) -> Result<Self, ImageError> {
        match check(data.len(), width, height, stride) {
            Ok(()) => Ok(Self { data, width, height, stride }),
            Err(e) => Err(e),
        }
    }

    /// Pixels in a row.
    #[must_use]
    pub const fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    #[must_use]
    pub const fn height(&self) -> usize {
        self.height
    }

    /// Width and height.
    #[must_use]
    pub const fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// The same pixels, read only.
    #[must_use]
    pub const fn as_view(&self) -> ImageView<'_, T> {
        ImageView { data: self.data, width: self.width, height: self.height, stride: self.stride }
    }

    /// The same pixels, borrowed for a shorter time.
    #[must_use]
    pub const fn reborrow(&mut self) -> ImageViewMut<'_, T> {
        ImageViewMut { data: self.data, width: self.width, height: self.height, stride: self.stride }
    }

    /// Row `y`, `width` pixels long; empty when `y` is outside.
    #[inline]
    #[must_use]
    pub fn row_mut(&mut self, y: usize) -> &mut [T] {
        if y >= self.height {
            return &mut [];
        }
        let start = y.saturating_mul(self.stride);
        match self.data.get_mut(start..).and_then(|rest| rest.get_mut(..self.width)) {
            Some(row) => row,
            None => &mut [],
        }
    }

    /// Writes one pixel; `false` when it is outside.
    #[inline]
    pub fn set(&mut self, x: usize, y: usize, value: T) -> bool {
        match self.row_mut(y).get_mut(x) {
            Some(pixel) => {
                *pixel = value;
                true
            }
            None => false,
        }
    }
}

impl<T: Copy> ImageViewMut<'_, T> {
    /// Writes `value` into every pixel; padding between rows is left alone.
    pub fn fill(&mut self, value: T) {
        for y in 0..self.height {
            self.row_mut(y).fill(value);
        }
    }
}

/// `W` x `H` pixels in fixed storage: `const`-constructible, so it can live in a `static`.
///
/// ```
/// use isobath::ground::image::Image;
/// static EMPTY: Image<u16, 160, 120> = Image::filled(0);
/// assert_eq!(size_of_val(&EMPTY), 160 * 120 * 2);
/// assert_eq!(EMPTY.view().size(), (160, 120));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(transparent)]
pub struct Image<T, const W: usize, const H: usize> {
    rows: [[T; W]; H],
}

impl<T: Copy, const W: usize, const H: usize> Image<T, W, H> {
    /// Every pixel set to `value`.
    #[must_use]
    pub const fn filled(value: T) -> Self {
        Self { rows: [[value; W]; H] }
    }
}

impl<T, const W: usize, const H: usize> Image<T, W, H> {
    /// From rows, top to bottom.
    #[must_use]
    pub const fn from_rows(rows: [[T; W]; H]) -> Self {
        Self { rows }
    }

    /// All pixels, row after row.
    #[must_use]
    pub const fn as_slice(&self) -> &[T] {
        self.rows.as_flattened()
    }

    /// All pixels, row after row, writable.
    #[must_use]
    pub const fn as_mut_slice(&mut self) -> &mut [T] {
        self.rows.as_flattened_mut()
    }

    /// A view of the whole image.
    #[must_use]
    pub const fn view(&self) -> ImageView<'_, T> {
        ImageView { data: self.rows.as_flattened(), width: W, height: H, stride: W }
    }

    /// A writable view of the whole image.
    #[must_use]
    pub const fn view_mut(&mut self) -> ImageViewMut<'_, T> {
        ImageViewMut { data: self.rows.as_flattened_mut(), width: W, height: H, stride: W }
    }
}

impl<T: Copy + Default, const W: usize, const H: usize> Default for Image<T, W, H> {
    fn default() -> Self {
        Self::filled(T::default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_that_cannot_be_are_refused() {
        let data = [0_u16; 12];
        assert_eq!(
            ImageView::with_stride(&data, 4, 3, 3).unwrap_err(),
            ImageError::StrideBelowWidth { stride: 3, width: 4 }
        );
        assert_eq!(ImageView::new(&data, 4, 4).unwrap_err(), ImageError::TooShort { needed: 16, got: 12 });
        assert_eq!(
            ImageView::with_stride(&data, 2, usize::MAX, usize::MAX).unwrap_err(),
            ImageError::TooShort { needed: usize::MAX, got: 12 }
        );
        // The last row needs no padding after it.
        assert!(ImageView::with_stride(&data, 4, 2, 8).is_ok());
    }

    #[test]
    fn empty_and_thin_images_work() {
        for (w, h) in [(0, 0), (0, 5), (5, 0), (1, 9), (9, 1)] {
            let data = [7_u16; 9];
            let view = ImageView::new(&data, w, h).unwrap();
            assert_eq!(view.rows().map(<[u16]>::len).sum::<usize>(), w * h);
            assert_eq!(view.get(w, 0), None);
            assert_eq!(view.get(0, h), None);
            assert_eq!(view.row(h), &[] as &[u16]);
            assert_eq!(view.get_signed(-1, 0), None);
        }
    }

    #[test]
    fn wide_images_work() {
        static WIDE: [u8; 65_535] = [3; 65_535];
        let view = ImageView::new(&WIDE, 65_535, 1).unwrap();
        assert_eq!(view.get(65_534, 0), Some(3));
        assert_eq!(view.crop(65_530, 0, 100, 100).size(), (5, 1));
    }

    #[test]
    fn cropping_keeps_pixels_in_place() {
        let image = Image::<u16, 4, 3>::from_rows([[0, 1, 2, 3], [10, 11, 12, 13], [20, 21, 22, 23]]);
        let crop = image.view().crop(1, 1, 2, 9);
        assert_eq!(crop.size(), (2, 2));
        assert_eq!(crop.row(1), &[21, 22]);
        assert!(image.view().crop(4, 0, 1, 1).is_empty());
        assert!(image.view().crop(usize::MAX, usize::MAX, 1, 1).is_empty());
    }

    #[test]
    fn writing_outside_is_refused_and_padding_is_kept() {
        let mut data = [9_u16; 6];
        let mut view = ImageViewMut::with_stride(&mut data, 2, 2, 3).unwrap();
        view.fill(0);
        assert!(view.set(1, 1, 5));
        assert!(!view.set(2, 1, 5));
        assert!(!view.set(0, 2, 5));
        assert_eq!(data, [0, 0, 9, 0, 5, 9]);
    }
}
