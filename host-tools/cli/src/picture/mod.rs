//! Pictures of what was computed: false colours for pixels, vector overlays for what is drawn over them.

pub(crate) mod colours;
pub(crate) mod frames;
pub(crate) mod map;
pub(crate) mod perspective;

pub(crate) use isobath_page::{raster, svg};
