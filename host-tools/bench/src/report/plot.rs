//! A scatter plot: time to the right (logarithmic), error upwards, the Pareto front drawn.

use isobath_page::svg::Svg;

use super::Mean;

const W: f32 = 560.0;
const H: f32 = 330.0;
const LEFT: f32 = 58.0;
const RIGHT: f32 = 18.0;
const TOP: f32 = 14.0;
const BOTTOM: f32 = 44.0;
const FONT: f32 = 12.0;

/// One axis: from a value to pixels, and where its marks are.
struct Axis {
    logarithmic: bool,
    low: f64,
    high: f64,
    from: f32,
    to: f32,
}

impl Axis {
    /// Wide enough for every value; logarithmic when asked, and where values differ by more than a factor of five.
    fn over(values: &[f64], logarithmic: bool, from: f32, to: f32) -> Self {
        let largest = values.iter().copied().fold(0.0, f64::max);
        let smallest = values.iter().copied().fold(f64::INFINITY, f64::min);
        if smallest > 0.0 && (logarithmic || largest / smallest > 5.0) {
            let (low, high) = (smallest / 1.35, largest * 1.35);
            // At least a factor of four, or all marks would coincide.
            let extra = (4.0 / (high / low)).max(1.0).sqrt();
            return Self { logarithmic: true, low: low / extra, high: high * extra, from, to };
        }
        let lowest = values.iter().copied().fold(0.0, f64::min) * 1.15;
        let high = if largest > 0.0 { largest * 1.15 } else { 1.0 };
        Self { logarithmic: false, low: lowest, high, from, to }
    }

    fn place(&self, value: f64) -> f32 {
        let t = if self.logarithmic {
            (value / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        };
        self.from + t.clamp(0.0, 1.0) as f32 * (self.to - self.from)
    }

    /// 1, 2, 5 times powers of ten within the axis; only the ones and threes when many.
    fn marks(&self) -> Vec<f64> {
        if self.logarithmic {
            let decades = (self.high / self.low).log10();
            let steps: &[f64] = if decades > 3.5 { &[1.0] } else { &[1.0, 2.0, 5.0] };
            let first = self.low.log10().floor() as i32;
            let all = (first..first + 20).flat_map(|d| steps.iter().map(move |s| s * 10.0_f64.powi(d)));
            return all.filter(|v| (self.low..=self.high).contains(v)).collect();
        }
        let rough = (self.high - self.low) / 5.0;
        let power = 10.0_f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|s| s * power).into_iter().find(|&s| s >= rough).unwrap_or(rough);
        let first = (self.low / step).ceil() as i64;
        (first..first + 12).map(|i| i as f64 * step).filter(|v| *v <= self.high).collect()
    }
}

/// The plot of one comparison; empty when there is nothing with both a time and an error.
pub(super) fn scatter(means: &[Mean], time: &str, error: &str, label: &str) -> String {
    let points: Vec<(&Mean, f64, f64)> = means
        .iter()
        .filter_map(|m| m.errors.first().map(|&e| (m, m.time, e)))
        .filter(|p| p.1.is_finite() && p.2.is_finite())
        .collect();
    if points.is_empty() {
        return String::new();
    }
    let times: Vec<f64> = points.iter().map(|p| p.1).collect();
    let errors: Vec<f64> = points.iter().map(|p| p.2).collect();
    let x = Axis::over(&times, true, LEFT, W - RIGHT);
    let y = Axis::over(&errors, false, H - BOTTOM, TOP);
    let mut svg = Svg::new(W, H, label);
    for v in x.marks() {
        let at = x.place(v);
        svg.polyline(&[[at, TOP], [at, H - BOTTOM]], "currentColor", 1.0, "class=\"grid\"");
        svg.text([at, H - BOTTOM + 16.0], FONT, &mark(v), "class=\"soft\" text-anchor=\"middle\"");
    }
    for v in y.marks() {
        let at = y.place(v);
        svg.polyline(&[[LEFT, at], [W - RIGHT, at]], "currentColor", 1.0, "class=\"grid\"");
        svg.text([LEFT - 7.0, at + 4.0], FONT, &mark(v), "class=\"soft\" text-anchor=\"end\"");
    }
    svg.text([0.5 * (LEFT + W - RIGHT), H - 8.0], FONT, time, "class=\"soft\" text-anchor=\"middle\"");
    let (cx, cy) = (14.0, 0.5 * (TOP + H - BOTTOM));
    let turned = format!("class=\"soft\" text-anchor=\"middle\" transform=\"rotate(-90 {cx} {cy})\"");
    svg.text([cx, cy], FONT, error, &turned);

    let at = |p: &(&Mean, f64, f64)| [x.place(p.1), y.place(p.2)];
    let mut front: Vec<[f32; 2]> = points.iter().filter(|p| p.0.front).map(at).collect();
    front.sort_by(|a, b| a[0].total_cmp(&b[0]));
    // A staircase: what the front promises between its methods is the error of the faster one.
    let mut stairs: Vec<[f32; 2]> = Vec::new();
    for &[px, py] in &front {
        if let Some(&[_, before]) = stairs.last() {
            stairs.push([px, before]);
        }
        stairs.push([px, py]);
    }
    if let Some(&[_, last]) = stairs.last() {
        stairs.push([W - RIGHT, last]);
    }
    svg.polyline(&stairs, "currentColor", 1.5, "class=\"front\"");
    let mut taken: Vec<[f32; 4]> =
        points.iter().map(at).map(|[px, py]| [px - 5.0, py - 5.0, px + 5.0, py + 5.0]).collect();
    // Labels stay off the line too.
    taken.extend(stairs.windows(2).map(|s| {
        let ([ax, ay], [bx, by]) = (s[0], s[1]);
        [ax.min(bx), ay.min(by) - 1.0, ax.max(bx), ay.max(by) + 1.0]
    }));
    let mut sorted = points.clone();
    sorted.sort_by_key(|p| !p.0.front);
    for p in &sorted {
        let [px, py] = at(p);
        let class = if p.0.front { "class=\"bar\"" } else { "class=\"beaten\"" };
        svg.circle([px, py], 4.5, "currentColor", class);
        let (place, anchor) = label_place([px, py], &p.0.method, &mut taken);
        let class = if p.0.front { "ink" } else { "soft" };
        svg.text(place, FONT, &p.0.method, &format!("class=\"{class}\" text-anchor=\"{anchor}\""));
    }
    svg.finish()
}

/// A mark's number, without zeros that say nothing.
fn mark(value: f64) -> String {
    if value != 0.0 && !(1e-4..1e6).contains(&value.abs()) {
        return format!("{value:.0e}");
    }
    let text = format!("{value:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Where a label stands: beside its point, where no other label or point is; else above the first choice's neighbours.
fn label_place([px, py]: [f32; 2], text: &str, taken: &mut Vec<[f32; 4]>) -> ([f32; 2], &'static str) {
    let wide = 0.56 * FONT * text.chars().count() as f32;
    let mut choices = Vec::new();
    for up in [0.0_f32, -11.0, 12.0, -22.0, 22.0, -34.0, 34.0] {
        choices.push(([px + 9.0, py + 4.0 + up], "start"));
        choices.push(([px - 9.0, py + 4.0 + up], "end"));
    }
    choices.push(([px, py - 10.0], "middle"));
    choices.push(([px, py + 18.0], "middle"));
    let area = |&([x, y], anchor): &([f32; 2], &str)| {
        let left = match anchor {
            "end" => x - wide,
            "middle" => x - 0.5 * wide,
            _ => x,
        };
        [left, y - 10.0, left + wide, y + 3.0]
    };
    let inside = |a: &[f32; 4]| a[0] > LEFT + 2.0 && a[2] < W - 2.0 && a[1] > 0.0 && a[3] < H - BOTTOM - 2.0;
    let clear = |a: &[f32; 4], taken: &[[f32; 4]]| {
        taken.iter().all(|b| a[2] < b[0] || b[2] < a[0] || a[3] < b[1] || b[3] < a[1])
    };
    let best = choices.iter().find(|c| inside(&area(c)) && clear(&area(c), taken));
    let best = best.or_else(|| choices.iter().find(|c| inside(&area(c)))).unwrap_or(&choices[0]);
    taken.push(area(best));
    *best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_hold_every_value() {
        for values in [vec![1.0, 1000.0], vec![5.0], vec![0.0, 0.0], vec![-3.0, 8.0], vec![1e-6, 1e6]] {
            for logarithmic in [true, false] {
                let axis = Axis::over(&values, logarithmic, 0.0, 100.0);
                for &v in &values {
                    assert!((0.0..=100.0).contains(&axis.place(v)), "{values:?}");
                }
                assert!((1..=22).contains(&axis.marks().len()), "{values:?}: {:?}", axis.marks());
            }
        }
    }

    #[test]
    fn labels_keep_apart() {
        let mut taken = Vec::new();
        let places: Vec<_> = (0..6).map(|_| label_place([200.0, 150.0], "a method", &mut taken).0).collect();
        for (i, a) in places.iter().enumerate() {
            assert!(places[..i].iter().all(|b| a != b));
        }
    }
}
