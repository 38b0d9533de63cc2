//! What is compared: one file a capability. See the crate's page for how to add one.

mod hit;
mod normals;
mod orientation;
mod planning;
mod points;
mod pyramid;
pub(crate) mod raycast;
mod registration;
pub(crate) mod room;
mod unpack;

use crate::row::Row;

/// Every row, in the order of the report.
pub const ALL: &[Row] = &[
    normals::DENSE,
    normals::FACETS,
    normals::SINGLE,
    points::POINTS,
    points::PROJECTION,
    pyramid::BUILD,
    raycast::CAST,
    hit::HIT,
    room::ROOM,
    planning::PATH,
    registration::REGISTRATION,
    orientation::SIMULATED,
    orientation::SLOW,
    orientation::VIBRATION,
    unpack::UNPACK,
];
