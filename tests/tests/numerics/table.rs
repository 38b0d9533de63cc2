//! The table that the suite fills: for each function the worst error met, where it was met, and the bound that holds it.

use std::fmt::Write as _;

use glam::{Quat, Vec2, Vec3};

/// Half an ulp of 1: the largest relative error of one correctly rounded `f32` operation.
pub(crate) const U: f64 = f32::EPSILON as f64 / 2.0;

/// One line of the table.
#[derive(Debug)]
pub(crate) struct Row {
    pub(crate) function: &'static str,
    /// What was tried.
    pub(crate) over: &'static str,
    /// What the error is measured in.
    pub(crate) unit: &'static str,
    pub(crate) worst: f64,
    /// The input that gave it.
    pub(crate) input: String,
    pub(crate) bound: f64,
    /// Where the bound comes from.
    pub(crate) why: &'static str,
    /// FNV-1a over the bits of every result.
    pub(crate) digest: u64,
}

/// The worst error met so far, and the bits of all results.
#[derive(Debug)]
pub(crate) struct Worst {
    value: f64,
    input: String,
    digest: u64,
    seen: u64,
}

impl Worst {
    pub(crate) const fn new() -> Self {
        Self { value: 0.0, input: String::new(), digest: 0xcbf2_9ce4_8422_2325, seen: 0 }
    }

    /// Takes an error; one that is not a number counts as infinite.
    pub(crate) fn see(&mut self, error: f64, input: impl FnOnce() -> String) {
        let error = if error.is_nan() { f64::INFINITY } else { error.abs() };
        self.seen += 1;
        if error > self.value || self.seen == 1 {
            (self.value, self.input) = (error, input());
        }
    }

    /// Takes a result's bits into the digest.
    pub(crate) fn bits(&mut self, bits: u32) {
        self.digest = (self.digest ^ u64::from(bits)).wrapping_mul(0x0100_0000_01b3);
    }

    pub(crate) fn f32(&mut self, v: f32) {
        self.bits(v.to_bits());
    }

    pub(crate) fn vec2(&mut self, v: Vec2) {
        v.to_array().into_iter().for_each(|c| self.f32(c));
    }

    pub(crate) fn vec3(&mut self, v: Vec3) {
        v.to_array().into_iter().for_each(|c| self.f32(c));
    }

    pub(crate) fn quat(&mut self, v: Quat) {
        v.to_array().into_iter().for_each(|c| self.f32(c));
    }

    pub(crate) fn row(
        self,
        function: &'static str,
        over: &'static str,
        unit: &'static str,
        bound: f64,
        why: &'static str,
    ) -> Row {
        assert!(self.seen > 0, "{function}: nothing was tried");
        Row { function, over, unit, worst: self.value, input: self.input, bound, why, digest: self.digest }
    }
}

/// Every row within its bound, and no bound more than it needs to be.
pub(crate) fn hold(rows: &[Row]) {
    for row in rows {
        println!("{}: {:.3e} {} of {:.3e} at {}", row.function, row.worst, row.unit, row.bound, row.input);
    }
    for row in rows {
        assert!(row.worst <= row.bound, "{}: {:e} {} at {}", row.function, row.worst, row.unit, row.input);
        let lazy = row.bound > 4.0 * row.worst;
        assert!(!lazy || row.bound == 0.0, "{}: bound {:e}, found {:e}: too wide", row.function, row.bound, row.worst);
    }
}

/// Two significant digits.
fn short(v: f64) -> String {
    if v == 0.0 {
        "0".into()
    } else if (0.01..1000.0).contains(&v) {
        let digits = if v < 0.1 {
            3
        } else if v < 1.0 {
            2
        } else {
            usize::from(v < 10.0)
        };
        format!("{v:.digits$}")
    } else {
        format!("{v:.1e}")
    }
}

/// The table as Markdown.
pub(crate) fn markdown(sections: &[(&str, &[Row])]) -> String {
    let mut text = String::new();
    for (title, rows) in sections {
        let _ = write!(
            text,
            "\n### {title}\n\n| function | over | worst | bound | unit | at | bits |\n|---|---|---|---|---|---|---|\n"
        );
        let cell = |s: &str| s.replace('|', "\\|");
        for r in *rows {
            let _ = writeln!(
                text,
                "| `{}` | {} | {} | {} | {} | {} | `{:08x}` |",
                r.function,
                r.over,
                short(r.worst),
                short(r.bound),
                cell(r.unit),
                cell(&r.input),
                (r.digest >> 32) ^ (r.digest & 0xffff_ffff)
            );
        }
        text.push('\n');
        for r in *rows {
            let _ = writeln!(text, "- `{}`: {}", r.function, r.why);
        }
    }
    text
}

/// Repeatable random numbers (xorshift).
#[derive(Debug)]
pub(crate) struct Dice(u64);

impl Dice {
    pub(crate) const fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    pub(crate) const fn bits(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / 16_777_216.0
    }

    pub(crate) fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// Even in the bits, so nearly in the logarithm: no library's `powf`, which may differ from machine to machine.
    pub(crate) const fn log(&mut self, low: f32, high: f32) -> f32 {
        let (a, b) = (low.to_bits(), high.to_bits());
        f32::from_bits(a + (self.bits() % (b - a + 1) as u64) as u32)
    }

    pub(crate) fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[(self.bits() % from.len() as u64) as usize]
    }

    pub(crate) fn vec3(&mut self, size: f32) -> Vec3 {
        Vec3::new(self.between(-size, size), self.between(-size, size), self.between(-size, size))
    }

    /// A quaternion of about unit length, any orientation.
    pub(crate) fn turn(&mut self) -> Quat {
        loop {
            let [x, y, z, w] = [0; 4].map(|_| self.between(-1.0, 1.0));
            let squares = x * x + y * y + z * z + w * w;
            if squares > 0.1 && squares < 1.0 {
                let length = squares.sqrt();
                return Quat::from_xyzw(x / length, y / length, z / length, w / length);
            }
        }
    }
}

/// What a rotation does, in f64, for a quaternion of any length.
pub(crate) fn rotate_f64(q: Quat, v: glam::DVec3) -> glam::DVec3 {
    let q = q.as_dquat();
    let b = glam::DVec3::new(q.x, q.y, q.z);
    let t = b.cross(v) * (2.0 / q.length_squared());
    v + t * q.w + b.cross(t)
}

/// The inverse of [`rotate_f64`].
pub(crate) fn rotate_back_f64(q: Quat, v: glam::DVec3) -> glam::DVec3 {
    rotate_f64(q.conjugate(), v)
}
