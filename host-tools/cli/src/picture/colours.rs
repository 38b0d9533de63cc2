//! Colours with a meaning.

/// What a hole looks like in every false-colour picture.
pub(crate) const HOLE: [u8; 3] = [40, 42, 48];

/// Free, blocked, room, unknown; the path; the cursor. Told apart by brightness too, for eyes that don't see the hue.
pub(crate) const FREE: &str = "#4ade80";
pub(crate) const BLOCKED: &str = "#fb5a5a";
pub(crate) const ROOM: &str = "#60a5fa";
pub(crate) const UNKNOWN: &str = "#cbd5e1";
pub(crate) const PATH: &str = "#facc15";
pub(crate) const CURSOR: &str = "#38e8ff";
pub(crate) const RAY: &str = "#f0abfc";

/// Google's Turbo colour map (Mikhailov 2019, Apache-2.0) as its published polynomial; `t` from 0 (violet) to 1 (red).
pub(crate) fn turbo(t: f32) -> [u8; 3] {
    let t = if t.is_finite() { t.clamp(0.0, 1.0) } else { 0.0 };
    let poly = |c: [f32; 6]| {
        let v = c.iter().rev().fold(0.0, |acc, k| acc * t + k);
        (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
    };
    [
        poly([0.135_721_38, 4.615_392_6, -42.660_324, 132.131_09, -152.942_4, 59.286_38]),
        poly([0.091_402_61, 2.194_188_4, 4.842_966_6, -14.185_033, 4.277_298_5, 2.829_566]),
        poly([0.106_673_3, 12.641_946, -60.582_047, 110.362_77, -89.903_11, 27.348_25]),
    ]
}

/// Near is red, far is violet: what is close catches the eye.
pub(crate) fn depth(z: f32, near: f32, far: f32) -> [u8; 3] {
    if z > 0.0 { turbo(1.0 - (z - near) / (far - near).max(1e-6)) } else { HOLE }
}

/// A unit normal in camera axes as a colour: x to red, -y (up) to green, -z (towards the eye) to blue.
pub(crate) fn normal(n: [f32; 3]) -> [u8; 3] {
    if n.iter().all(|v| v.is_finite()) {
        [n[0], -n[1], -n[2]].map(|v| ((v * 0.5 + 0.5).clamp(0.0, 1.0) * 255.0 + 0.5) as u8)
    } else {
        HOLE
    }
}

/// As `#rrggbb`.
pub(crate) fn hex([r, g, b]: [u8; 3]) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turbo_runs_from_violet_over_green_to_red() {
        let [low, mid, high] = [0.0, 0.5, 1.0].map(turbo);
        assert!(low[2] > low[1] && low[0] < 80, "{low:?}");
        assert!(mid[1] > 200, "{mid:?}");
        assert!(high[0] > 100 && high[1] < 40 && high[2] < 40, "{high:?}");
        assert_eq!(turbo(f32::NAN), turbo(0.0));
    }

    #[test]
    fn a_wall_that_faces_the_eye_is_blue() {
        assert_eq!(normal([0.0, 0.0, -1.0]), [128, 128, 255]);
        assert_eq!(normal([f32::NAN, 0.0, 0.0]), HOLE);
    }
}
