//! The page: a card and a plot for each comparison, tables below.

use isobath_page::{Card, Figure, Page, Table};

use super::{Report, Skip, machine, number, plot};
use crate::row::Row;
use crate::sequence::Kind;

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
    let exact = || report.skips.iter().filter(|s| s.exact);
    let different: usize = exact().map(|s| s.different).sum();
    let queries: usize = exact().map(|s| s.queries).sum();
    page.cards.push(Card {
        name: "Answers that skipping changes".into(),
        value: format!("{different} of {queries}"),
        detail: "on exact depth, compared to the last bit; must be 0".into(),
    });
    let header = ["feature: scene", "size", "skipped", "full ns", "skip ns", "speed-up", "different"];
    let (mut single, mut sequences): (Vec<_>, Vec<_>) = report.skips.iter().partition(|s| s.kind.is_none());
    single.sort_by_key(|s| (s.feature, s.size));
    sequences.sort_by_key(|s| (s.feature, s.size));
    page.tables.push(Table {
        title: "Skipping on single frames".into(),
        note: "Per query; the pyramid's build is part of the skipping time, shared by all queries of a frame.".into(),
        header: header.map(String::from).to_vec(),
        rows: single
            .into_iter()
            .map(|s| [what(s, &s.scene), numbers(s), vec![format!("{} of {}", s.different, s.queries)]].concat())
            .collect(),
        ..Table::default()
    });
    let more = ["map ns", "kept against new, mean", "worst", "error full", "error skipping"];
    page.tables.push(Table {
        title: "Skipping over sequences".into(),
        note: "Per pixel of a frame; the tile map's update (map ns) is part of the skipping time. Angles in degrees: what was \
               kept against what would be computed, and both forms against the truth, which recordings have not. On exact depth \
               nothing may differ; with noise both are estimates of the same surface."
            .into(),
        header: header.into_iter().chain(more).map(String::from).collect(),
        rows: sequences
            .into_iter()
            .map(|s| {
                let kind = s.kind.map_or("", Kind::label);
                let change = s.change.unwrap_or_default();
                let map = s.summary.map_or(f64::NAN, |t| t.best);
                let rest = [map, change.mean, change.worst, change.error_full, change.error_skipping].map(number);
                let different = format!("{:.1} %", 100.0 * s.different as f64 / s.queries.max(1) as f64);
                let name = format!("{}, {kind}, {}", s.scene, s.sensor);
                [what(s, &name), numbers(s), vec![different], rest.to_vec()].concat()
            })
            .collect(),
        ..Table::default()
    });
    page.notes.extend(report.notes.iter().cloned());
}

fn what(skip: &Skip, name: &str) -> Vec<String> {
    vec![format!("{}: {name}", skip.feature), format!("{}x{}", skip.size.0, skip.size.1)]
}

fn numbers(skip: &Skip) -> Vec<String> {
    let times = [skip.full.best, skip.skipping.best].map(number);
    let share = format!("{:.1} %", 100.0 * skip.skipped);
    [vec![share], times.to_vec(), vec![format!("{:.2}x", skip.speed_up())]].concat()
}

#[cfg(test)]
mod tests {
    use super::super::tests::example;

    #[test]
    fn the_page_has_every_method_and_needs_nothing_else() {
        let page = example().html();
        for needed in
            ["adaptive", "&lt;slow&gt;", "ns per pixel", "ray cast, pyramid: wall", "living-room, static", "<svg"]
        {
            assert!(page.contains(needed), "{needed}");
        }
        for outside in ["<slow>", "<script", "<link", "https://"] {
            assert!(!page.contains(outside), "{outside}");
        }
    }
}
