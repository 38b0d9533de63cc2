//! Numerical stability: every function against an f64 oracle over the hostile end of its range, each with the worst error
//! found, its input, and a bound that an error analysis gives. The table is docs/numerics.md: `cargo xtask docs --numerics` writes
//! it, and a test here says when it is out of date.

use std::path::Path;

mod answers;
mod cameras;
mod filters;
mod poses;
mod surfaces;
mod table;

/// What stands above the table.
const ESSAY: &str = include_str!("essay.md");

fn document() -> String {
    let sections: [(&str, &[table::Row]); 5] = [
        ("Cameras and depth values", &cameras::ROWS),
        ("Poses, planes and rays", &poses::ROWS),
        ("Surfaces", &surfaces::ROWS),
        ("Answers", &answers::ROWS),
        ("Roots and filters", &filters::ROWS),
    ];
    ESSAY.to_owned() + &table::markdown(&sections)
}

#[test]
fn the_document_is_up_to_date() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/numerics.md");
    let now = document();
    if std::env::var_os("ISOBATH_WRITE_NUMERICS").is_some() {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, now).unwrap();
        return;
    }
    let committed = std::fs::read_to_string(&path).unwrap_or_default();
    let differs = now.lines().zip(committed.lines()).find(|(a, b)| a != b);
    assert!(
        now == committed,
        "docs/numerics.md is out of date (`cargo xtask docs --numerics` writes it anew): {differs:?}"
    );
}
