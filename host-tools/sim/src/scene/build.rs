//! From a scene's text to the scene: every number checked, every name resolved.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use super::file::{
    CameraFile, LightFile, MaterialFile, ObjectFile, PatternFile, SceneFile, ShapeFile, SurroundingsFile,
};
use super::motion::{Motion, turned};
use super::{Object, Scene, View};
use crate::error::SimError;
use crate::maths::{Rigid, V3};
use crate::render::camera::SimCamera;
use crate::render::light::Light;
use crate::render::sky::Sky;
use crate::render::surface::{Material, Pattern};
use crate::shape::facets::{self, Polyhedron};
use crate::shape::mesh::{Mesh, Triangle};
use crate::shape::waves::{Wave, Waves};
use crate::shape::{Shape, mesh_file};

/// Nothing in a scene is farther or larger than this, metres: `f64` keeps nanometres there.
const LARGEST: f64 = 1e5;
/// Objects, keys, waves, lights: more is a mistake.
const MOST: usize = 100_000;
/// Faces of a polyhedron: each ray asks all of them.
const MOST_FACES: u32 = 200;
/// Facets of a torus knot along or around it, and times that a ball is cut.
const MOST_RINGS: u32 = 2000;
const MOST_LEVELS: u32 = 7;
/// Samples of an area light, squared.
const MOST_SAMPLES: u8 = 16;

/// Where a complaint points.
struct At<'a> {
    scene: &'a str,
}

impl At<'_> {
    fn error(&self, what: impl Into<String>) -> SimError {
        SimError::Scene { scene: self.scene.to_owned(), what: what.into() }
    }

    fn length(&self, of: &str, v: f64) -> Result<f64, SimError> {
        if v > 0.0 && v <= LARGEST {
            return Ok(v);
        }
        Err(self.error(format!("{of} is {v}; it must be more than 0 and at most {LARGEST} (metres)")))
    }

    fn point(&self, of: &str, v: [f64; 3]) -> Result<V3, SimError> {
        if v.iter().all(|c| c.abs() <= LARGEST) {
            return Ok(v.into());
        }
        Err(self.error(format!("{of} is {v:?}; coordinates must be numbers within {LARGEST} m of the origin")))
    }

    fn angles(&self, of: &str, v: [f64; 3]) -> Result<[f64; 3], SimError> {
        if v.iter().all(|c| c.abs() <= 36_000.0) {
            return Ok(v);
        }
        Err(self.error(format!("{of}: turn is {v:?}; it is yaw, pitch and roll in degrees")))
    }

    fn direction(&self, of: &str, v: [f64; 3]) -> Result<V3, SimError> {
        V3::from(v).unit().ok_or_else(|| self.error(format!("{of} is {v:?}; a direction must be finite and not 0 0 0")))
    }

    fn colour(&self, of: &str, v: [f64; 3], most: f64) -> Result<V3, SimError> {
        if v.iter().all(|c| (0.0..=most).contains(c)) {
            return Ok(v.into());
        }
        Err(self.error(format!("{of} is {v:?}; its three numbers (linear red, green, blue) must be 0 to {most}")))
    }

    fn fraction(&self, of: &str, v: f64) -> Result<f64, SimError> {
        if (0.0..=1.0).contains(&v) {
            return Ok(v);
        }
        Err(self.error(format!("{of} is {v}; it must be 0 to 1")))
    }
}

pub(super) fn build(name: &str, file: SceneFile, folder: &Path) -> Result<Scene, SimError> {
    let at = At { scene: name };
    for (what, count) in [("objects", file.object.len()), ("lights", file.light.len()), ("groups", file.groups.len())] {
        if count > MOST {
            return Err(at.error(format!("{count} {what}; at most {MOST} are supported")));
        }
    }
    let view = View {
        eye: at.point("view: eye", file.view.eye)?,
        target: at.point("view: target", file.view.target)?,
        roam: file.view.roam,
    };
    if (view.target - view.eye).length() < 1e-6 {
        return Err(at.error("view: eye and target are the same point; the camera would look nowhere"));
    }
    if !view.roam.iter().all(|r| (0.0..=LARGEST).contains(r)) {
        return Err(at.error(format!("view: roam is {:?}; give two lengths in metres", view.roam)));
    }
    let exposure = at.length("exposure", file.exposure)?;
    let ambient =
        [at.colour("ambient: up", file.ambient.up, 1e6)?, at.colour("ambient: down", file.ambient.down, 1e6)?];
    let unit = match file.unit {
        None => None,
        Some(u) if (1e-6..=10.0).contains(&u) => Some(u),
        Some(u) => return Err(at.error(format!("unit is {u}; it is metres per step of 16-bit depth, 0.000001 to 10"))),
    };
    let camera = file.view.camera.map(|c| camera(&at, c)).transpose()?;
    let sky = sky(&at, file.surroundings, folder)?;
    let mut places = BTreeMap::new();
    for (place, p) in file.places {
        let p = at.point(&format!("places: {place}"), p)?;
        places.insert(place, p);
    }

    let mut materials = Vec::new();
    let mut material_index = BTreeMap::new();
    for (material, m) in file.materials {
        material_index.insert(material.clone(), materials.len() as u32);
        materials.push(self::material(&at, &material, m, folder)?);
    }
    let (mut motions, mut group_index) = (Vec::new(), BTreeMap::new());
    for (group, g) in file.groups {
        let of = format!("group {group:?}");
        let base = Rigid { rotation: turned(at.angles(&of, g.turn)?), translation: at.point(&of, g.at)? };
        for pair in g.keys.windows(2) {
            if !(pair[1].time > pair[0].time) {
                return Err(
                    at.error(format!("{of}: key times go from {} to {}; they must grow", pair[0].time, pair[1].time))
                );
            }
        }
        for key in &g.keys {
            at.angles(&of, key.turn)?;
            at.point(&format!("{of}: shift"), key.shift)?;
            if !(key.time.abs() <= 1e6) {
                return Err(at.error(format!("{of}: a key's time is {}; it must be seconds below a million", key.time)));
            }
        }
        group_index.insert(group, motions.len());
        motions.push(Motion::new(base, g.keys, g.after));
    }

    let mut segments: Vec<String> = Vec::new();
    let mut objects = Vec::with_capacity(file.object.len());
    for o in file.object {
        let of = format!("object {:?}", o.name);
        let material = *material_index.get(&o.material).ok_or_else(|| {
            let known: Vec<&str> = material_index.keys().map(String::as_str).collect();
            at.error(format!("{of}: there is no material {:?}; defined are: {}", o.material, known.join(", ")))
        })?;
        let group = match &o.group {
            None => None,
            Some(g) => Some(
                *group_index
                    .get(g)
                    .ok_or_else(|| at.error(format!("{of}: there is no group {g:?}; define it as [groups.{g}]")))?,
            ),
        };
        let segment = o.segment.as_ref().or(o.group.as_ref()).unwrap_or(&o.name);
        let id = segments.iter().position(|s| s == segment).unwrap_or_else(|| {
            segments.push(segment.clone());
            segments.len() - 1
        });
        let segment =
            u16::try_from(id + 1).map_err(|_| at.error("more than 65535 segments; name some of them alike"))?;
        let place = Rigid { rotation: turned(at.angles(&of, o.turn)?), translation: at.point(&of, o.at)? };
        let shape = shape(&at, &of, &o, folder)?;
        objects.push(Object { shape, place, group, material, segment, shadow: o.shadow });
    }
    let lights = file.light.iter().enumerate().map(|(i, l)| light(&at, i, l)).collect::<Result<Vec<_>, _>>()?;
    Ok(Scene {
        name: name.to_owned(),
        about: file.about,
        view,
        camera,
        unit,
        places,
        segments,
        objects,
        motions,
        materials,
        lights,
        sky,
        ambient,
        exposure,
    })
}

fn camera(at: &At<'_>, c: CameraFile) -> Result<SimCamera, SimError> {
    let [width, height] = c.size.map(|n| n as usize);
    let ([fx, fy], [cx, cy]) = (c.focal, c.centre);
    let camera = SimCamera { width, height, fx, fy, cx, cy, lens: [0.0; 8] }.in_f32();
    camera.check().map(|()| camera).map_err(|e| at.error(format!("view: camera: {e}")))
}

fn shape(at: &At<'_>, of: &str, o: &ObjectFile, folder: &Path) -> Result<Shape, SimError> {
    let length = |what: &str, v: f64| at.length(&format!("{of}: {what}"), v);
    Ok(match &o.shape {
        ShapeFile::Plane { normal } => Shape::Plane { normal: at.direction(&format!("{of}: normal"), *normal)? },
        ShapeFile::Rectangle { size } => {
            Shape::Rectangle { half: [0.5 * length("size", size[0])?, 0.5 * length("size", size[1])?] }
        }
        ShapeFile::Box { size: [x, y, z] } => {
            Shape::Box { half: V3 { x: length("size", *x)?, y: length("size", *y)?, z: length("size", *z)? } * 0.5 }
        }
        ShapeFile::Sphere { radius } => Shape::Sphere { radius: length("radius", *radius)? },
        ShapeFile::Cylinder { radius, height } => {
            Shape::Cylinder { radius: length("radius", *radius)?, half: 0.5 * length("height", *height)? }
        }
        ShapeFile::Capsule { radius, height } => {
            let (radius, height) = (length("radius", *radius)?, length("height", *height)?);
            if height < 2.0 * radius {
                return Err(at.error(format!(
                    "{of}: a capsule {height} m high can't have a radius of {radius} m; its height includes both round ends"
                )));
            }
            Shape::Capsule { radius, half: 0.5 * height - radius }
        }
        ShapeFile::Waves { size, waves } => {
            if waves.is_empty() || waves.len() > 64 {
                return Err(at.error(format!("{of}: {} waves; give 1 to 64", waves.len())));
            }
            let waves = waves.iter().map(|w| {
                let k = std::f64::consts::TAU / length("wave length", w.length)?;
                let (s, c) = libm::sincos(w.direction.clamp(-36e3, 36e3).to_radians());
                let phase = w.phase.clamp(-36e3, 36e3).to_radians();
                Ok(Wave { amplitude: length("wave amplitude", w.amplitude)?, k: [k * c, k * s], phase })
            });
            let waves = waves.collect::<Result<Vec<_>, SimError>>()?;
            Shape::Waves(Waves { half: [0.5 * length("size", size[0])?, 0.5 * length("size", size[1])?], waves })
        }
        ShapeFile::Polyhedron { radius, faces, seed } => {
            if *faces < 4 || *faces > MOST_FACES {
                return Err(at.error(format!("{of}: {faces} faces; give 4 to {MOST_FACES}")));
            }
            let body = Polyhedron::around(length("radius", *radius)?, *faces, *seed);
            Shape::Polyhedron(body.ok_or_else(|| {
                at.error(match seed {
                    None => format!(
                        "{of}: no regular solid has {faces} faces; give 4, 6, 8, 12 or 20, or a seed for a random one"
                    ),
                    Some(_) => {
                        format!("{of}: {faces} random faces that leave it open; give another seed, or more faces")
                    }
                })
            })?)
        }
        ShapeFile::TorusKnot { radius, tube, winds, facets } => {
            let (radius, tube) = (length("radius", *radius)?, length("tube", *tube)?);
            if !winds.iter().all(|w| (1..=50).contains(w)) {
                return Err(
                    at.error(format!("{of}: winds {winds:?}; give how often it goes around and through, 1 to 50"))
                );
            }
            if !facets.iter().all(|n| (3..=MOST_RINGS).contains(n)) {
                return Err(at.error(format!("{of}: facets {facets:?}; give rings and sides, 3 to {MOST_RINGS}")));
            }
            solid(at, of, facets::torus_knot(radius, tube, *winds, *facets))?
        }
        ShapeFile::Icosphere { radius, level, roughness, seed } => {
            if *level > MOST_LEVELS {
                return Err(at.error(format!("{of}: level {level}; give 0 to {MOST_LEVELS}")));
            }
            let roughness = at.fraction(&format!("{of}: roughness"), *roughness)?;
            solid(at, of, facets::icosphere(length("radius", *radius)?, *level, roughness, *seed))?
        }
        ShapeFile::Mesh { file, scale } => {
            let path = folder.join(file);
            let mesh = mesh_file::read(&path, length("scale", *scale)?)?;
            Shape::Mesh(Arc::new(mesh))
        }
    })
}

/// A mesh made here rather than read.
fn solid(at: &At<'_>, of: &str, triangles: Vec<Triangle>) -> Result<Shape, SimError> {
    let mesh = Mesh::new(triangles);
    if mesh.len() == 0 {
        return Err(at.error(format!("{of} has no facet with an area")));
    }
    Ok(Shape::Mesh(Arc::new(mesh)))
}

fn material(at: &At<'_>, name: &str, m: MaterialFile, folder: &Path) -> Result<Material, SimError> {
    let of = |what: &str| format!("material {name:?}: {what}");
    let pattern = match m.pattern {
        None => Pattern::None,
        Some(PatternFile::Checker { colour, size }) => Pattern::Checker {
            colour: at.colour(&of("checker colour"), colour, 1.0)?,
            size: at.length(&of("checker size"), size)?,
        },
        Some(PatternFile::Boards { width, length, variation }) => Pattern::Boards {
            width: at.length(&of("board width"), width)?,
            length: at.length(&of("board length"), length)?,
            variation: at.fraction(&of("variation"), variation)?,
        },
        Some(PatternFile::Speckle { colour, size }) => Pattern::Speckle {
            colour: at.colour(&of("speckle colour"), colour, 1.0)?,
            size: at.length(&of("speckle size"), size)?,
        },
        Some(PatternFile::Image { file, repeat }) => {
            if !repeat.iter().all(|r| r.abs() <= 1e6) {
                return Err(at.error(of("repeat must be two numbers")));
            }
            Pattern::image(&folder.join(file), repeat)?
        }
    };
    Ok(Material {
        colour: at.colour(&of("colour"), m.colour, 1.0)?,
        pattern,
        mirror: at.fraction(&of("mirror"), m.mirror)?,
        emission: at.colour(&of("emission"), m.emission, 1e6)?,
    })
}

fn light(at: &At<'_>, index: usize, l: &LightFile) -> Result<Light, SimError> {
    let of = |what: &str| format!("light {} ({what})", index + 1);
    Ok(match *l {
        LightFile::Point { at: p, intensity } => {
            Light::Point { at: at.point(&of("at"), p)?, intensity: at.colour(&of("intensity"), intensity, 1e9)? }
        }
        LightFile::Sun { from, irradiance } => Light::Sun {
            from: at.direction(&of("from"), from)?,
            irradiance: at.colour(&of("irradiance"), irradiance, 1e9)?,
        },
        LightFile::Area { at: p, turn, size, radiance, samples } => {
            if samples == 0 || samples > MOST_SAMPLES {
                return Err(at.error(format!("{} is {samples}; give 1 to {MOST_SAMPLES}", of("samples"))));
            }
            Light::Area {
                place: Rigid { rotation: turned(at.angles(&of("turn"), turn)?), translation: at.point(&of("at"), p)? },
                size: [at.length(&of("size"), size[0])?, at.length(&of("size"), size[1])?],
                radiance: at.colour(&of("radiance"), radiance, 1e9)?,
                samples: u32::from(samples),
            }
        }
    })
}

fn sky(at: &At<'_>, s: SurroundingsFile, folder: &Path) -> Result<Sky, SimError> {
    let colour = |of: &str, v| at.colour(&format!("surroundings: {of}"), v, 1e6);
    Ok(match s {
        SurroundingsFile::Constant(c) => Sky::Constant(colour("constant", c)?),
        SurroundingsFile::Gradient { top, horizon, bottom } => Sky::Gradient {
            top: colour("top", top)?,
            horizon: colour("horizon", horizon)?,
            bottom: colour("bottom", bottom)?,
        },
        SurroundingsFile::Hdr { file, turn, scale } => {
            let scale = at.length("surroundings: scale", scale)?;
            let turn = at.angles("surroundings", [turn, 0.0, 0.0])?[0];
            Sky::hdr(&folder.join(file), turn.to_radians(), scale)?
        }
    })
}
