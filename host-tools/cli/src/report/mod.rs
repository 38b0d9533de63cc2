//! `report.html`: what the main job found, on the page that all host tools share (`isobath_page`).

pub(crate) mod charts;
pub(crate) mod drawings;
pub(crate) mod run;

pub(crate) use isobath_page::{Card, Figure, Page, Table};
