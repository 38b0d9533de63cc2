//! Vector drawings: crisp at any size, small, and readable without a script. Coordinates are pixels of the picture below,
//! pixel centres at integers, as everywhere in isobath; the view box makes up for the half pixel.

use std::fmt::Write as _;

use base64::Engine as _;

use crate::raster::Raster;

/// A drawing in work.
#[derive(Debug)]
pub struct Svg {
    width: f32,
    height: f32,
    body: String,
    label: String,
}

impl Svg {
    /// An empty drawing; the label is for those who hear it read.
    #[must_use]
    pub fn new(width: f32, height: f32, label: &str) -> Self {
        Self { width, height, body: String::new(), label: label.to_owned() }
    }

    /// A drawing over a picture of the same size; an unencodable (empty) picture is left out.
    #[must_use]
    pub fn over(raster: &Raster, label: &str) -> Self {
        let (w, h) = raster.size();
        let mut svg = Self::new(w as f32, h as f32, label);
        svg.picture(raster, -0.5, -0.5, w as f32, h as f32, false);
        svg
    }

    /// A picture placed in the drawing; `blocky` shows its pixels as squares.
    pub fn picture(&mut self, raster: &Raster, x: f32, y: f32, w: f32, h: f32, blocky: bool) {
        if let Ok(png) = raster.png() {
            let data = base64::engine::general_purpose::STANDARD.encode(png);
            let style = if blocky { " style=\"image-rendering:pixelated\"" } else { "" };
            let _ = writeln!(
                self.body,
                r#"<image x="{x:.2}" y="{y:.2}" width="{w:.2}" height="{h:.2}" preserveAspectRatio="none"{style} href="data:image/png;base64,{data}"/>"#
            );
        }
    }

    /// Anything else, as it is.
    pub fn raw(&mut self, element: &str) {
        self.body.push_str(element);
        self.body.push('\n');
    }

    /// A line through points; `extra` holds attributes such as a dash pattern.
    pub fn polyline(&mut self, points: &[[f32; 2]], colour: &str, width: f32, extra: &str) {
        if points.len() >= 2 {
            let points = list(points);
            let _ = writeln!(
                self.body,
                r#"<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{width}" stroke-linecap="round" stroke-linejoin="round" {extra}/>"#
            );
        }
    }

    /// A filled outline.
    pub fn polygon(&mut self, points: &[[f32; 2]], fill: &str, extra: &str) {
        let points = list(points);
        let _ = writeln!(self.body, r#"<polygon points="{points}" fill="{fill}" {extra}/>"#);
    }

    /// A filled circle.
    pub fn circle(&mut self, [x, y]: [f32; 2], radius: f32, fill: &str, extra: &str) {
        let _ = writeln!(self.body, r#"<circle cx="{x:.2}" cy="{y:.2}" r="{radius:.2}" fill="{fill}" {extra}/>"#);
    }

    /// A rectangle from its upper left corner.
    pub fn rect(&mut self, x: f32, y: f32, w: f32, h: f32, extra: &str) {
        let _ = writeln!(self.body, r#"<rect x="{x:.2}" y="{y:.2}" width="{w:.2}" height="{h:.2}" {extra}/>"#);
    }

    /// Text from its base line; `extra` holds its class and anchor.
    pub fn text(&mut self, [x, y]: [f32; 2], size: f32, text: &str, extra: &str) {
        let text = escape(text);
        let _ = writeln!(self.body, r#"<text x="{x:.2}" y="{y:.2}" font-size="{size}" {extra}>{text}</text>"#);
    }

    /// Text with a dark rim, readable over any picture; moved inwards where it would leave the drawing.
    pub fn label(&mut self, [x, y]: [f32; 2], size: f32, text: &str, colour: &str, anchor: &str) {
        // About the width of bold text in the usual fonts.
        let wide = 0.62 * size * text.chars().count() as f32;
        let left = match anchor {
            "middle" => 0.5 * wide,
            "end" => wide,
            _ => 0.0,
        };
        let margin = 0.3 * size;
        let x = x.clamp(left + margin, (self.width - (wide - left) - margin).max(left + margin));
        let at = [x, y.clamp(size + margin, (self.height - margin).max(size + margin))];
        let extra = format!(
            r#"fill="{colour}" text-anchor="{anchor}" font-weight="600" paint-order="stroke" stroke="rgba(8,12,20,.85)" stroke-width="{:.2}" stroke-linejoin="round""#,
            size * 0.28
        );
        self.text(at, size, text, &extra);
    }

    /// The finished element, to stand in an HTML page.
    #[must_use]
    pub fn finish(self) -> String {
        let Self { width, height, body, label } = self;
        format!(
            "<svg viewBox=\"-0.5 -0.5 {width} {height}\" role=\"img\" aria-label=\"{}\" xmlns=\"http://www.w3.org/2000/svg\">\n{body}</svg>",
            escape(&label)
        )
    }
}

fn list(points: &[[f32; 2]]) -> String {
    let mut out = String::new();
    for [x, y] in points {
        let _ = write!(out, "{x:.2},{y:.2} ");
    }
    out.pop();
    out
}

/// Text made safe to stand in HTML or SVG.
#[must_use]
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_break_the_page() {
        let mut svg = Svg::new(10.0, 10.0, "a\"b");
        svg.text([0.0, 0.0], 8.0, "<script>", "");
        let page = svg.finish();
        assert!(!page.contains("<script>"));
        assert!(page.contains("&lt;script&gt;") && page.contains("a&quot;b"));
    }
}
