//! What a real sensor makes of exact depth: stages, applied in order.
//!
//! | text | stage | what it does |
//! |---|---|---|
//! | `none` | | exact depth |
//! | `noise:A,B,C` | [`Stage::Noise`] | normal noise of standard deviation A + B z + C z² metres |
//! | `disparity:N` | [`Stage::Disparity`] | z becomes N / round(N / z): a triangulating sensor's steps, z² / N apart |
//! | `quantised:U` | [`Stage::Quantised`] | whole steps of U metres |
//! | `range:A..B` | [`Stage::Range`] | holes nearer than A and farther than B metres |
//! | `occlusion:B` | [`Stage::Occlusion`] | holes where a second eye, B metres to the right, does not see |
//! | `flying:S` | [`Stage::FlyingPixels`] | at edges, a share S of pixels lies between foreground and background |
//! | `multipath:S` | [`Stage::Multipath`] | inner corners lie too deep, S times the mean detour of light |
//! | `confidence` | [`Stage::Confidence`] | confidence from the returned light: cosine of incidence over z² |
//! | `rolling` | [`Stage::Rolling`] | a band of low confidence and doubled noise that rolls down the image, frame by frame |
//!
//! Stages combine with `+`. Named sensors are combinations: `kinect` = `noise:0,0,0.001425+disparity:348`; `kinect-full` adds
//! `occlusion:0.075` and `range:0.5..8`; `stereo` = `occlusion:0.05+noise:0,0,0.0006+disparity:680+range:0.2..10`; `tof` =
//! `flying:0.6+multipath:0.15+noise:0.002,0.005,0+confidence+range:0.15..6`.
//!
//! Noise: Khoshelham and Elberink 2012 (doi 10.3390/s120201437) for Kinect; 348 = 580 px x 7.5 cm x 8 steps a pixel. Each pixel's random
//! numbers depend on the seed, the frame, the stage and the pixel, and nothing else.

mod edges;
mod pixels;

use std::fmt;
use std::str::FromStr;

use crate::error::SimError;
use crate::random::Random;
use crate::render::GroundTruth;
use crate::render::camera::SimCamera;

/// One thing that a sensor does to depth; lengths in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Stage {
    /// Normal noise of standard deviation `constant` + `linear` z + `quadratic` z².
    Noise {
        /// Metres.
        constant: f64,
        /// Metres per metre.
        linear: f64,
        /// Metres per metre squared.
        quadratic: f64,
    },
    /// Whole steps of disparity.
    Disparity {
        /// Disparity steps times metres: focal length x baseline x steps a pixel.
        steps: f64,
    },
    /// Whole steps of depth.
    Quantised {
        /// Metres per step.
        unit: f64,
    },
    /// Holes outside a range.
    Range {
        /// Nearest reading, metres.
        min: f64,
        /// Farthest reading, metres.
        max: f64,
    },
    /// Holes where a second eye does not see.
    Occlusion {
        /// How far the second eye is to the right, metres; negative: to the left.
        baseline: f64,
    },
    /// Pixels between foreground and background.
    FlyingPixels {
        /// Share of the pixels at edges, 0 to 1.
        share: f64,
    },
    /// Inner corners too deep.
    Multipath {
        /// Part of the mean detour of light that is added.
        strength: f64,
    },
    /// Confidence from the returned light.
    Confidence,
    /// A band of low confidence that rolls down the image.
    Rolling,
}

/// A depth sensor: its stages in order. Parsed from text, see [the module's table](self).
///
/// ```
/// use isobath_sim::SensorModel;
/// let sensor: SensorModel = "kinect+range:0.5..8".parse()?;
/// assert_eq!(sensor.to_string(), "noise:0,0,0.001425+disparity:348+range:0.5..8");
/// assert!("kinnect".parse::<SensorModel>().is_err());
/// # Ok::<(), isobath_sim::SimError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SensorModel {
    /// The stages, first to last.
    pub stages: Vec<Stage>,
}

/// What the sensor reports.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Sensed {
    /// z depth, metres; 0 in holes.
    pub z: Vec<f64>,
    /// 0 (not at all) to 255 (certain), when the sensor tells.
    pub confidence: Option<Vec<u8>>,
}

const NAMED: &[(&str, &str)] = &[
    ("kinect", "noise:0,0,0.001425+disparity:348"),
    ("kinect-full", "occlusion:0.075+noise:0,0,0.001425+disparity:348+range:0.5..8"),
    ("stereo", "occlusion:0.05+noise:0,0,0.0006+disparity:680+range:0.2..10"),
    ("tof", "flying:0.6+multipath:0.15+noise:0.002,0.005,0+confidence+range:0.15..6"),
];

impl FromStr for SensorModel {
    type Err = SimError;

    fn from_str(text: &str) -> Result<Self, SimError> {
        let mut stages = Vec::new();
        for part in text.split('+').map(str::trim) {
            if part == "none" {
                continue;
            }
            match NAMED.iter().find(|(name, _)| *name == part) {
                Some((_, whole)) => stages.extend(whole.parse::<Self>()?.stages),
                None => stages.push(stage(part)?),
            }
        }
        Ok(Self { stages })
    }
}

/// One stage from its text.
fn stage(text: &str) -> Result<Stage, SimError> {
    let (name, rest) = text.split_once(':').unwrap_or((text, ""));
    let numbers: Option<Vec<f64>> = if rest.is_empty() {
        Some(Vec::new())
    } else {
        rest.replace("..", ",").split(',').map(|w| w.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect()
    };
    let usage = match name {
        "noise" => "noise:A,B,C with a standard deviation of A + B z + C z² metres, none negative",
        "disparity" => "disparity:N with N > 0, focal length (px) x baseline (m) x steps a pixel",
        "quantised" | "quantized" => "quantised:U with a step of U > 0 metres",
        "range" => "range:A..B with 0 <= A < B metres",
        "occlusion" => "occlusion:B with the second eye B metres to the right (negative: left)",
        "flying" => "flying:S with a share of 0 to 1",
        "multipath" => "multipath:S with a strength of 0 to 10",
        "confidence" | "rolling" => "this one without a number",
        _ => {
            let named: Vec<&str> = NAMED.iter().map(|(n, _)| *n).collect();
            return Err(SimError::option(format!(
                "there is no sensor {text:?}; give none, {}, or stages joined by +: noise:A,B,C disparity:N quantised:U range:A..B \
                 occlusion:B flying:S multipath:S confidence rolling",
                named.join(", ")
            )));
        }
    };
    let found = match (name, numbers.as_deref()) {
        ("noise", Some(&[constant, linear, quadratic])) if constant >= 0.0 && linear >= 0.0 && quadratic >= 0.0 => {
            Some(Stage::Noise { constant, linear, quadratic })
        }
        ("disparity", Some(&[steps])) if steps > 0.0 => Some(Stage::Disparity { steps }),
        ("quantised" | "quantized", Some(&[unit])) if unit > 0.0 => Some(Stage::Quantised { unit }),
        ("range", Some(&[min, max])) if min >= 0.0 && min < max => Some(Stage::Range { min, max }),
        ("occlusion", Some(&[baseline])) => Some(Stage::Occlusion { baseline }),
        ("flying", Some(&[share])) if (0.0..=1.0).contains(&share) => Some(Stage::FlyingPixels { share }),
        ("multipath", Some(&[strength])) if (0.0..=10.0).contains(&strength) => Some(Stage::Multipath { strength }),
        ("confidence", Some(&[])) => Some(Stage::Confidence),
        ("rolling", Some(&[])) => Some(Stage::Rolling),
        _ => None,
    };
    found.ok_or_else(|| SimError::option(format!("the sensor stage {text:?} is not usable; write {usage}")))
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Noise { constant, linear, quadratic } => write!(f, "noise:{constant},{linear},{quadratic}"),
            Self::Disparity { steps } => write!(f, "disparity:{steps}"),
            Self::Quantised { unit } => write!(f, "quantised:{unit}"),
            Self::Range { min, max } => write!(f, "range:{min}..{max}"),
            Self::Occlusion { baseline } => write!(f, "occlusion:{baseline}"),
            Self::FlyingPixels { share } => write!(f, "flying:{share}"),
            Self::Multipath { strength } => write!(f, "multipath:{strength}"),
            Self::Confidence => write!(f, "confidence"),
            Self::Rolling => write!(f, "rolling"),
        }
    }
}

impl fmt::Display for SensorModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.stages.is_empty() {
            return write!(f, "none");
        }
        for (i, stage) in self.stages.iter().enumerate() {
            write!(f, "{}{stage}", if i > 0 { "+" } else { "" })?;
        }
        Ok(())
    }
}

impl SensorModel {
    /// Whether depth stays exact.
    #[must_use]
    pub const fn is_none(&self) -> bool {
        self.stages.is_empty()
    }

    /// What the sensor reports of a frame. The camera is the one the truth was seen with; `frame` counts from 0.
    #[must_use]
    pub fn sense(&self, truth: &GroundTruth, camera: &SimCamera, seed: u64, frame: u64) -> Sensed {
        let mut sensed = Sensed { z: truth.z.clone(), confidence: None };
        let random = Random::new(seed).stream(0x3333).stream(frame);
        for (i, stage) in self.stages.iter().enumerate() {
            let random = random.stream(i as u64);
            match *stage {
                Stage::Noise { constant, linear, quadratic } => {
                    pixels::noise(&mut sensed.z, [constant, linear, quadratic], random);
                }
                Stage::Disparity { steps } => pixels::each(&mut sensed.z, |z| steps / libm::round(steps / z)),
                Stage::Quantised { unit } => pixels::each(&mut sensed.z, |z| libm::round(z / unit) * unit),
                Stage::Range { min, max } => {
                    pixels::each(&mut sensed.z, |z| if z >= min && z <= max { z } else { 0.0 });
                }
                Stage::Occlusion { baseline } => edges::occlusion(&mut sensed.z, truth, camera.fx * baseline),
                Stage::FlyingPixels { share } => edges::flying(&mut sensed, truth, share, random),
                Stage::Multipath { strength } => edges::multipath(&mut sensed.z, truth, camera, strength),
                Stage::Confidence => pixels::confidence(&mut sensed, truth, camera),
                Stage::Rolling => pixels::rolling(&mut sensed, truth.width, frame, random),
            }
        }
        // A sensor that sees nothing is not sure of it.
        if let Some(confidence) = &mut sensed.confidence {
            for (c, z) in confidence.iter_mut().zip(&sensed.z) {
                *c = if *z > 0.0 { (*c).max(1) } else { 0 };
            }
        }
        sensed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::{Rigid, V3, v3};
    use crate::scene::Scene;

    fn camera() -> SimCamera {
        SimCamera::from_fov(160, 120, 1.1).unwrap()
    }

    fn truth(name: &str) -> GroundTruth {
        let scene = Scene::open(name).unwrap();
        scene.render_geometry(0.0, &camera(), &Rigid::looking_at(scene.view().eye, scene.view().target))
    }

    fn sense(text: &str, truth: &GroundTruth) -> Sensed {
        text.parse::<SensorModel>().unwrap().sense(truth, &camera(), 7, 0)
    }

    #[test]
    fn texts_round_trip_and_bad_ones_say_what_to_write() {
        for text in
            ["none", "kinect", "kinect-full", "tof", "stereo", "quantised:0.001", "kinect+rolling", "occlusion:-0.05"]
        {
            let model: SensorModel = text.parse().unwrap();
            assert_eq!(model.to_string().parse::<SensorModel>().unwrap(), model, "{text}");
        }
        for (bad, word) in [
            ("", "kinect"),
            ("lidar", "kinect-full"),
            ("quantised", "quantised:U"),
            ("quantised:0", "quantised:U"),
            ("noise:1,2", "noise:A,B,C"),
            ("noise:-1,0,0", "none negative"),
            ("range:3..1", "0 <= A < B"),
            ("range:nan..1", "0 <= A < B"),
            ("disparity:inf", "disparity:N"),
            ("flying:2", "0 to 1"),
            ("kinect+", "stages joined"),
        ] {
            let error = bad.parse::<SensorModel>().unwrap_err().to_string();
            assert!(error.contains(word), "{bad}: {error}");
        }
    }

    #[test]
    fn no_stages_change_nothing() {
        let t = truth("desk");
        assert_eq!(sense("none", &t), Sensed { z: t.z.clone(), confidence: None });
    }

    #[test]
    fn kinect_noise_is_as_large_as_published() {
        let t = truth("wall");
        let s = sense("noise:0,0,0.001425", &t);
        let n = s.z.len() as f64;
        let mean = s.z.iter().map(|z| z - 2.0).sum::<f64>() / n;
        let sigma = (s.z.iter().map(|z| (z - 2.0) * (z - 2.0)).sum::<f64>() / n).sqrt();
        assert!(mean.abs() < 2e-4 && (sigma / (1.425e-3 * 4.0) - 1.0).abs() < 0.02, "{mean} {sigma}");
        let s = sense("kinect", &t);
        assert!(
            s.z.iter().all(|z| {
                let d = 348.0 / z;
                (d - libm::round(d)).abs() < 1e-9
            }),
            "whole steps of disparity"
        );
    }

    #[test]
    fn steps_and_ranges_are_kept() {
        let t = truth("living-room");
        let s = sense("quantised:0.01+range:2..4", &t);
        for (z, exact) in s.z.iter().zip(&t.z) {
            if *z > 0.0 {
                assert!((z - exact).abs() <= 0.005 + 1e-12 && (2.0..=4.0).contains(z));
            } else {
                assert!(*exact < 2.0051 || *exact > 3.9949);
            }
        }
    }

    #[test]
    fn occluded_pixels_are_those_the_second_eye_does_not_see() {
        // Against rays: what is in front of the line from the surface to the second eye.
        let scene = Scene::open("sphere").unwrap();
        let pose = Rigid::looking_at(scene.view().eye, scene.view().target);
        let t = scene.render_geometry(0.0, &camera(), &pose);
        let s = sense("occlusion:0.1", &t);
        let eye = pose.point(v3(0.1, 0.0, 0.0));
        let right = Rigid { translation: eye, ..pose };
        let seen = scene.render_geometry(0.0, &camera(), &right);
        let (mut agree, mut holes, mut n) = (0, 0, 0);
        for i in 0..t.z.len() {
            let p = camera().ray((i % 160) as f64, (i / 160) as f64).unwrap() * t.z[i];
            let Some([x, y]) = camera().project(p - v3(0.1, 0.0, 0.0)) else { continue };
            let inside = x > -0.5 && x < 159.5;
            let visible = inside && {
                let z = seen.z[y.round() as usize * 160 + (x.round() as usize).min(159)];
                z > p.z - 0.05
            };
            n += 1;
            holes += usize::from(s.z[i] == 0.0);
            agree += usize::from(visible == (s.z[i] > 0.0));
        }
        assert!(holes > 200 && agree * 100 > n * 97, "{holes} {agree} {n}");
    }

    #[test]
    fn flying_pixels_stand_between_and_only_at_edges() {
        let t = truth("sphere");
        let s = sense("flying:0.8", &t);
        let (low, high) = (t.z.iter().copied().fold(f64::MAX, f64::min), t.z.iter().copied().fold(0.0, f64::max));
        let changed = s.z.iter().zip(&t.z).filter(|(a, b)| a != b).count();
        assert!(changed > 50 && changed < t.z.len() / 10, "{changed}");
        assert!(s.z.iter().all(|z| *z >= low && *z <= high));
        let wall = truth("wall");
        assert_eq!(sense("flying:1", &wall).z, wall.z);
    }

    #[test]
    fn multipath_bends_inner_corners_only() {
        let t = truth("corner");
        let s = sense("multipath:0.15", &t);
        let most = s.z.iter().zip(&t.z).map(|(a, b)| a - b).fold(0.0, f64::max);
        assert!(most > 0.002 && most < 0.1, "{most}");
        assert!(s.z.iter().zip(&t.z).all(|(a, b)| a >= b));
        let tilted = truth("tilted");
        assert!(sense("multipath:1", &tilted).z.iter().zip(&tilted.z).all(|(a, b)| (a - b).abs() < 1e-9));
    }

    #[test]
    fn confidence_follows_light_and_the_band_rolls() {
        let t = truth("living-room");
        let s = sense("confidence", &t);
        let c = s.confidence.unwrap();
        assert!(c.iter().zip(&s.z).all(|(c, z)| (*c > 0) == (*z > 0.0)));
        let model: SensorModel = "rolling".parse().unwrap();
        let wall = truth("wall");
        let darkest = |frame| {
            let c = model.sense(&wall, &camera(), 1, frame).confidence.unwrap();
            let row = |y: usize| c[y * 160..(y + 1) * 160].iter().map(|v| u32::from(*v)).sum::<u32>();
            (0..120).min_by_key(|&y| row(y)).unwrap()
        };
        assert!(darkest(0) != darkest(3));
    }

    #[test]
    fn frames_and_seeds_differ_and_repeat() {
        let t = truth("desk");
        let model: SensorModel = "tof+rolling".parse().unwrap();
        let a = model.sense(&t, &camera(), 1, 0);
        assert_eq!(a, model.sense(&t, &camera(), 1, 0));
        assert_ne!(a, model.sense(&t, &camera(), 1, 1));
        assert_ne!(a, model.sense(&t, &camera(), 2, 0));
        assert!(a.z.iter().all(|z| z.is_finite() && *z >= 0.0));
        let empty = GroundTruth::default();
        assert!(model.sense(&empty, &camera(), 1, 0).z.is_empty());
        let _ = V3::ZERO;
    }
}
