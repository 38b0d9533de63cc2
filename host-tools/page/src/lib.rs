//! A report: one HTML page that needs nothing else. No script, no font, no link: it can be mailed, archived, printed.
//!
//! The page is a list of parts (cards, figures, tables) in a fixed frame; what they show is decided elsewhere. Colours
//! follow the reader's light or dark preference through CSS variables, which the charts use too.

pub mod raster;
pub mod svg;

use std::fmt::Write as _;

use svg::escape;

/// A finding in a few words, at the top of the page.
#[derive(Debug)]
pub struct Card {
    /// What it is about.
    pub name: String,
    /// The finding.
    pub value: String,
    /// What it rests on.
    pub detail: String,
}

/// A drawing with its caption.
#[derive(Debug)]
pub struct Figure {
    /// Above the drawing.
    pub title: String,
    /// An `<svg>` element.
    pub drawing: String,
    /// Another `<svg>` or nothing: a colour bar, a key.
    pub legend: String,
    /// Plain text.
    pub caption: String,
    /// Takes the whole width.
    pub wide: bool,
}

/// A table; the first column is a heading, numbers stand to the right.
#[derive(Debug, Default)]
pub struct Table {
    /// Above the table.
    pub title: String,
    /// Below it.
    pub note: String,
    /// Of each column.
    pub header: Vec<String>,
    /// Cells, as long as the header.
    pub rows: Vec<Vec<String>>,
    /// Which rows to show in red.
    pub bad: Vec<usize>,
    /// Shut until the reader opens it, for what is long.
    pub folded: bool,
}

/// The page's parts.
#[derive(Debug)]
pub struct Page {
    /// Heading, and name of the window.
    pub title: String,
    /// A line under the heading.
    pub subtitle: String,
    /// Findings, first on the page.
    pub cards: Vec<Card>,
    /// Drawings.
    pub figures: Vec<Figure>,
    /// Tables.
    pub tables: Vec<Table>,
    /// Sentences, last on the page.
    pub notes: Vec<String>,
}

const STYLE: &str = include_str!("style.css");

impl Page {
    /// The finished file.
    #[must_use]
    pub fn html(&self) -> String {
        let mut out = String::new();
        let title = escape(&self.title);
        let _ = writeln!(
            out,
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <title>isobath: {title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
             <header><p class=\"brand\">isobath</p><h1>{title}</h1><p>{}</p></header>\n<main>",
            escape(&self.subtitle)
        );
        out.push_str("<section class=\"cards\">\n");
        for Card { name, value, detail } in &self.cards {
            let [name, value, detail] = [name, value, detail].map(|t| escape(t));
            let _ = writeln!(out, "<article><h2>{name}</h2><p class=\"value\">{value}</p><p>{detail}</p></article>");
        }
        out.push_str("</section>\n<section class=\"figures\">\n");
        for figure in &self.figures {
            figure.html(&mut out);
        }
        out.push_str("</section>\n<section class=\"tables\">\n");
        for table in &self.tables {
            table.html(&mut out);
        }
        out.push_str("</section>\n");
        if !self.notes.is_empty() {
            out.push_str("<section class=\"notes\"><h2>Notes</h2><ul>\n");
            for note in &self.notes {
                let _ = writeln!(out, "<li>{}</li>", escape(note));
            }
            out.push_str("</ul></section>\n");
        }
        let _ = writeln!(out, "</main>\n<footer>isobath {}</footer>\n</body>\n</html>", env!("CARGO_PKG_VERSION"));
        out
    }
}

impl Figure {
    fn html(&self, out: &mut String) {
        let class = if self.wide { " class=\"wide\"" } else { "" };
        let _ = writeln!(
            out,
            "<figure{class}>\n<h2>{}</h2>\n{}\n<div class=\"legend\">{}</div>\n<figcaption>{}</figcaption>\n</figure>",
            escape(&self.title),
            self.drawing,
            self.legend,
            escape(&self.caption)
        );
    }
}

impl Table {
    fn html(&self, out: &mut String) {
        let title = escape(&self.title);
        let (open, shut) = if self.folded {
            (format!("<details><summary><h2>{title}</h2></summary>"), "</details>")
        } else {
            (format!("<h2>{title}</h2>"), "")
        };
        // Many columns don't fit beside another table.
        let wide = if self.header.len() > 5 { " wide" } else { "" };
        let _ = writeln!(out, "<div class=\"table{wide}\">{open}<table><thead><tr>");
        for cell in &self.header {
            let _ = write!(out, "<th scope=\"col\">{}</th>", escape(cell));
        }
        out.push_str("</tr></thead><tbody>\n");
        for (i, row) in self.rows.iter().enumerate() {
            out.push_str(if self.bad.contains(&i) { "<tr class=\"bad\">" } else { "<tr>" });
            for (i, cell) in row.iter().enumerate() {
                let cell = escape(cell);
                let _ =
                    if i == 0 { write!(out, "<th scope=\"row\">{cell}</th>") } else { write!(out, "<td>{cell}</td>") };
            }
            out.push_str("</tr>\n");
        }
        let _ = writeln!(out, "</tbody></table><p>{}</p>{shut}</div>", escape(&self.note));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_needs_nothing_else_and_trusts_no_name() {
        let page = Page {
            title: "<b>evil</b>".into(),
            subtitle: "one & two".into(),
            cards: vec![],
            figures: vec![],
            tables: vec![Table {
                title: "t".into(),
                note: String::new(),
                header: vec!["<i>".into()],
                ..Table::default()
            }],
            notes: vec!["<u>".into()],
        }
        .html();
        assert!(!page.contains("<b>") && !page.contains("<i>") && !page.contains("<u>"));
        for outside in ["http://", "https://", "<script", "<link", "url("] {
            assert!(!page.contains(outside), "{outside}");
        }
    }
    #[test]
    fn rows_are_red_and_tables_fold_when_asked() {
        let rows = vec![vec!["fine".to_owned()], vec!["lost".to_owned()]];
        let table = Table { title: "t".into(), rows, bad: vec![1], folded: true, ..Table::default() };
        let mut out = String::new();
        table.html(&mut out);
        assert!(
            out.contains("<tr class=\"bad\"><th scope=\"row\">lost") && out.matches("class=\"bad\"").count() == 1,
            "{out}"
        );
        assert!(out.contains("<details><summary><h2>t</h2></summary>") && out.contains("</details></div>"), "{out}");
    }
}
