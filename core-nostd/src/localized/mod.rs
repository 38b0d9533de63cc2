//! Localized depth: answers about a few points of one frame (DepthLab, "Interaction with Localized Depth").
//!
//! Two half floors. *Kernels* know only what lies below this module: [`normals`], [`plane`], [`raycast`], [`one_euro`].
//! *Features* may use kernels, and take what another feature computed as an argument.
//!
//! | feature | question |
//! |---|---|
//! | [`hit`] | what is behind this pixel or screen point? |
//! | [`reflect`] | where does a ray go after it bounces? |
//! | [`particles`] | where do rain and snow land? |
//! | [`measure`] | how far, how high, with which error? |
//! | [`reticle`] | how does the cursor lie on the surface? |
//! | [`collision`] | does this object collide with the real scene? |
//! | [`placement`] | where is there room for it? |
//! | [`height_map`] | how high is the ground, cell by cell? |
//! | [`planner`] | how does one walk there, around what can't be climbed? |
//! | [`avatar`] | how does the paper's avatar hover over the scene? |

pub mod avatar;
pub mod collision;
pub mod height_map;
pub mod hit;
pub mod measure;
pub mod normals;
pub mod one_euro;
pub mod particles;
pub mod placement;
pub mod plane;
pub mod planner;
pub mod raycast;
pub mod reflect;
pub mod reticle;
