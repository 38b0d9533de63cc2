//! The page: a card and a plot for each comparison, tables below.

use isobath_page::{Card, Figure, Page, Table};

use super::{Report, machine, number, plot};
use crate::row::Row;

/// Everything, as the page that all host tools share.
pub(super) fn page(report: &Report) -> Page {
    let sizes: Vec<String> = report.sizes().iter().map(|(w, h)| format!("{w}x{h}")).collect();
    let mut page = Page {
        title: "Run time against error".into(),
        subtitle: format!(
            "Simulated frames with known truth, {}; one thread; {}. Lower left is better.",
            sizes.join(" and "),
            machine()
        ),
        cards: Vec::new(),
        figures: Vec::new(),
        tables: Vec::new(),
        notes: vec![
            "Methods take turns in one process; times are the mean over scenes of each scene's best round.".into(),
            "The line joins the Pareto front: methods that no other beats in both time and error. In tables they bear a star.".into(),
            "bench.csv and bench.json hold every scene by itself, and the median round.".into(),
        ],
    };
    if report.quick {
        page.notes
            .push("The quick form: few scenes, one size, few rounds. Times waver by ten per cent and more.".into());
    }
    for row in report.rows() {
        if let Some(&size) = report.sizes().last() {
            figures(report, row, size, &mut page);
        }
        for size in report.sizes() {
            page.tables.extend(table(report, row, size));
        }
    }
    super::peers::page(report, &mut page);
    skips(report, &mut page);
    page
}

fn figures(report: &Report, row: &Row, size: (usize, usize), page: &mut Page) {
    let scenes = report.scenes(row, size).join(", ");
    let measure = row.errors[0];
    for &sensor in row.sensors {
        let means = report.means(row, sensor, size, None);
        // A plot of one point says less than the table.
        if means.len() < 2 {
            continue;
        }
        let title = format!("{}: {}", row.title, sensor.label());
        page.figures.push(Figure {
            drawing: plot::scatter(
                &means,
                &format!("ns per {} (logarithmic)", row.unit),
                &format!("{}, {}", measure.name, measure.unit),
                &title,
            ),
            title,
            legend: String::new(),
            caption: format!("{}. {}x{}; {scenes}.", sentence(measure.what), size.0, size.1),
            wide: false,
        });
        let best = means.iter().filter(|m| m.front).min_by(|a, b| a.errors[0].total_cmp(&b.errors[0]));
        if let Some(best) = best.filter(|_| row.name == "normals") {
            page.cards.push(Card {
                name: title_of(row, sensor.label()),
                value: format!("{} {} at {} ns", number(best.errors[0]), measure.unit, number(best.time)),
                detail: format!("{}, the most accurate; {}x{}", best.method, size.0, size.1),
            });
        }
    }
}

fn title_of(row: &Row, sensor: &str) -> String {
    format!("{}, {sensor}", row.title)
}

/// With a capital letter.
fn sentence(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or_else(String::new, |c| c.to_uppercase().chain(chars).collect())
}

/// One line a sensor and method.
fn table(report: &Report, row: &Row, size: (usize, usize)) -> Option<Table> {
    let mut header = vec!["sensor: method".to_owned(), format!("ns/{}", row.unit)];
    header.extend(row.errors.iter().map(|m| format!("{} {}", m.name, m.unit)));
    let mut rows = Vec::new();
    for &sensor in row.sensors {
        let means = report.means(row, sensor, size, None);
        for mean in &means {
            let star = if mean.front && means.len() > 1 { "* " } else { "" };
            let name = format!("{}: {}", sensor.label(), mean.method);
            let cells = [name, format!("{star}{}", number(mean.time))];
            rows.push(cells.into_iter().chain(mean.errors.iter().map(|&e| number(e))).collect());
        }
    }
    let notes: Vec<String> = row.errors.iter().map(|m| format!("{}: {}", m.name, m.what)).collect();
    let title = format!("{}, {}x{}", row.title, size.0, size.1);
    (!rows.is_empty()).then(|| Table {
        title,
        note: format!("{}.", notes.join("; ")),
        header,
        rows,
        ..Table::default()
    })
}

fn skips(report: &Report, page: &mut Page) {
    if report.skips.is_empty() {
        return;
    }
    let different: usize = report.skips.iter().map(|s| s.different).sum();
    let queries: usize = report.skips.iter().map(|s| s.queries).sum();
    page.cards.push(Card {
        name: "Answers that skipping changes".into(),
        value: format!("{different} of {queries}"),
        detail: "compared to the last bit; must be 0".into(),
    });
    let header = ["feature: scene", "size", "skipped", "full ns", "skip ns", "speed-up", "different"];
    let mut sorted: Vec<_> = report.skips.iter().collect();
    sorted.sort_by_key(|s| (s.feature, s.size));
    page.tables.push(Table {
        title: "Skipping".into(),
        note: "Per query; the pyramid's build is part of the skipping time, shared by all queries of a frame.".into(),
        header: header.map(String::from).to_vec(),
        rows: sorted
            .into_iter()
            .map(|s| {
                vec![
                    format!("{}: {}", s.feature, s.scene),
                    format!("{}x{}", s.size.0, s.size.1),
                    format!("{:.1} %", 100.0 * s.skipped),
                    number(s.full.best),
                    number(s.skipping.best),
                    format!("{:.2}x", s.speed_up()),
                    format!("{} of {}", s.different, s.queries),
                ]
            })
            .collect(),
        ..Table::default()
    });
}

#[cfg(test)]
mod tests {
    use super::super::tests::example;

    #[test]
    fn the_page_has_every_method_and_needs_nothing_else() {
        let page = example().html();
        for needed in ["adaptive", "&lt;slow&gt;", "ns per pixel", "ray cast, pyramid: wall", "<svg"] {
            assert!(page.contains(needed), "{needed}");
        }
        for outside in ["<slow>", "<script", "<link", "https://"] {
            assert!(!page.contains(outside), "{outside}");
        }
    }
}
