//! One file a command: ask the core, tell people or machines.

pub(crate) mod bench;
pub(crate) mod completions;
pub(crate) mod devices;
pub(crate) mod envmap;
pub(crate) mod find_place;
pub(crate) mod hit;
pub(crate) mod info;
pub(crate) mod measure;
pub(crate) mod normals;
pub(crate) mod path;
pub(crate) mod place;
pub(crate) mod points;
pub(crate) mod probe;
pub(crate) mod raycast;
pub(crate) mod record;
pub(crate) mod run;
pub(crate) mod sim;
