//! Scenes: built from their text, checked once, posed at a time.
//!
//! The world is right-handed with y up, in metres. [`Scene`] holds what does not change; [`World`] is the scene at one time, with
//! its tree, ready for rays.

mod build;
pub(crate) mod file;
mod motion;
mod named;
mod world;

pub use named::NAMES;
pub(crate) use world::{Hit, World};

use std::collections::BTreeMap;
use std::path::Path;

use crate::error::SimError;
use crate::maths::V3;
use crate::render::camera::SimCamera;
use crate::render::light::Light;
use crate::render::sky::Sky;
use crate::render::surface::Material;
use crate::shape::Shape;
use motion::Motion;

/// Full horizontal field of view unless a scene or an option says otherwise, radians.
const FIELD_OF_VIEW: f64 = 1.1;

/// A scene, checked and ready to be seen.
#[derive(Debug, Clone)]
pub struct Scene {
    name: String,
    about: String,
    view: View,
    /// Of the size that the scene's file names; `None`: the usual one.
    camera: Option<SimCamera>,
    pub(crate) unit: Option<f64>,
    places: BTreeMap<String, V3>,
    segments: Vec<String>,
    objects: Vec<Object>,
    motions: Vec<Motion>,
    pub(crate) materials: Vec<Material>,
    pub(crate) lights: Vec<Light>,
    pub(crate) sky: Sky,
    pub(crate) ambient: [V3; 2],
    pub(crate) exposure: f64,
}

/// Where a scene is looked at from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// The camera's place, metres.
    pub eye: V3,
    /// What it looks at, metres.
    pub target: V3,
    /// Half-axes of the ellipse that a walk follows, metres along world x and z.
    pub roam: [f64; 2],
}

/// One object of a scene.
#[derive(Debug, Clone)]
struct Object {
    shape: Shape,
    place: crate::maths::Rigid,
    /// Index into the motions, when it belongs to a group.
    group: Option<usize>,
    material: u32,
    segment: u16,
    shadow: bool,
}

impl Scene {
    /// A named scene ([`NAMES`]), or the scene in a file whose name ends in `.toml`.
    ///
    /// ```
    /// let scene = isobath_sim::Scene::open("living-room")?;
    /// assert!(scene.segments().contains(&"sofa".to_owned()));
    /// # Ok::<(), isobath_sim::SimError>(())
    /// ```
    ///
    /// # Errors
    /// [`SimError`]: no such scene; a file that can't be read; a text that is no scene.
    pub fn open(name: &str) -> Result<Self, SimError> {
        if let Some(text) = named::text(name) {
            return Self::parse(name, text, Path::new("."));
        }
        let path = Path::new(name);
        if path.extension().is_none_or(|e| e != "toml") {
            return Err(SimError::UnknownScene { name: name.to_owned() });
        }
        let text = std::fs::read_to_string(path).map_err(SimError::read(path))?;
        Self::parse(name, &text, path.parent().unwrap_or(Path::new(".")))
    }

    /// From a scene's text; `folder` is where the files that it names lie.
    ///
    /// # Errors
    /// [`SimError`]: what is wrong, with its line or its object's name.
    pub fn parse(name: &str, text: &str, folder: &Path) -> Result<Self, SimError> {
        let file: file::SceneFile =
            toml::from_str(text).map_err(|e| SimError::Scene { scene: name.to_owned(), what: e.to_string() })?;
        build::build(name, file, folder)
    }

    /// Its name or path.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What it shows, in a sentence.
    #[must_use]
    pub fn about(&self) -> &str {
        &self.about
    }

    /// Where it is looked at from unless told otherwise.
    #[must_use]
    pub const fn view(&self) -> &View {
        &self.view
    }

    /// The camera that the scene is meant for, at this image size: the scene's own, scaled to the width and cropped to the height,
    /// or else square pixels and 1.1 radians (63 degrees) from left to right.
    ///
    /// # Errors
    /// [`SimError::Option`] for an unusable size.
    pub fn camera(&self, width: usize, height: usize) -> Result<SimCamera, SimError> {
        match &self.camera {
            Some(own) => own.scaled_to(width, height),
            None => SimCamera::from_fov(width, height, FIELD_OF_VIEW),
        }
    }

    /// Named places (metres): where a virtual object may stand and its light be asked for.
    #[must_use]
    pub const fn places(&self) -> &BTreeMap<String, V3> {
        &self.places
    }

    /// The same scene with one more place, or one moved: where its light is asked for, at any point (metres).
    ///
    /// # Errors
    /// [`SimError::Option`] when the point is not finite.
    pub fn with_place(mut self, name: &str, at: V3) -> Result<Self, SimError> {
        if !at.is_finite() {
            return Err(SimError::option(format!(
                "the place {name:?} is at {at:?}; give three finite numbers in metres"
            )));
        }
        self.places.insert(name.to_owned(), at);
        Ok(self)
    }

    /// Names of the segments; segment id n (from 1) is the n-th of these, 0 is nothing.
    #[must_use]
    pub fn segments(&self) -> &[String] {
        &self.segments
    }

    /// Whether anything moves.
    #[must_use]
    pub fn moves(&self) -> bool {
        self.motions.iter().any(|m| !m.keys.is_empty())
    }

    /// Linear radiance times this is 1.0 at sRGB white.
    #[must_use]
    pub const fn exposure(&self) -> f64 {
        self.exposure
    }

    /// The scene at a time in seconds.
    #[must_use]
    pub(crate) fn at(&self, time: f64) -> World<'_> {
        World::new(self, time)
    }
}
