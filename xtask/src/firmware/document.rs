//! `docs/footprint.md`: the stored figures as tables.

use std::fmt::Write as _;

use super::figures::Figures;

/// The stages that the localized job's budget names, and the others of a frame.
pub(super) const JOB: [&str; 4] = ["pyramid", "hits", "places", "replan"];
const FRAME: [&str; 8] = ["decode", "tiles", "pyramid", "normals-asked", "hits", "places", "map", "replan"];

/// Clocks of the parts that rates are computed for, hertz, and cycles an instruction that are taken for them.
const PARTS: [(&str, f64, f64); 2] = [("200 MHz Cortex-M4F", 200e6, 1.4), ("480 MHz Cortex-M7", 480e6, 0.9)];

/// The document.
pub(super) fn render(figures: &Figures) -> String {
    let mut text = String::from(
        "# Footprint: what the core costs on a device\n\n\
         Written by `cargo xtask firmware --store`, checked by `cargo xtask firmware` (3 %). Images: `tests/firmware`, in QEMU, \
         optimised for speed (`opt-level = 3`). Frames: 160x120, a simulated living room with a Kinect's noise.\n",
    );
    instructions(figures, &mut text);
    rates(figures, &mut text);
    stack(figures, &mut text);
    memory(figures, &mut text);
    flash(figures, &mut text);
    text
}

fn per(figures: &Figures, board: &str, stage: &str) -> String {
    let total = figures.get(&format!("{board}.instructions"), stage).unwrap_or(0);
    let times = figures.get("times", stage).unwrap_or(1).max(1);
    let each = total as f64 / times as f64;
    if each < 1000.0 { format!("{each:.1}") } else { format!("{each:.0}") }
}

fn instructions(figures: &Figures, text: &mut String) {
    *text += "\n## Instructions\n\nOf the worst of six frames, in thousands; and of one pixel, hit, place. `light-` and `key-frame-`: a lighting session of the preset `tiny` on key frames of 96x72 and 32x24 (`tests/firmware/job/src/lighting.rs`). Counted by QEMU (`-icount shift=0`), \
              to 40 instructions on the M4.\n\n\
              | stage | times | M4F, 1000 | each | M55, 1000 | each | A53, 1000 | each |\n|---|--:|--:|--:|--:|--:|--:|--:|\n";
    let others = figures.section("times").map(|(name, _)| name).filter(|name| !FRAME.contains(name));
    let row = |text: &mut String, stage: &str| {
        let times = figures.get("times", stage).unwrap_or(1);
        let _ = write!(text, "| {stage} | {times} |");
        for board in ["cortex-m4", "cortex-m55", "cortex-a53"] {
            let total = figures.get(&format!("{board}.instructions"), stage).unwrap_or(0);
            let _ = write!(text, " {:.0} | {} |", total as f64 / 1000.0, per(figures, board, stage));
        }
        *text += "\n";
    };
    FRAME.iter().for_each(|stage| row(text, stage));
    let _ = writeln!(text, "| *the whole frame* | | {} |", sums(figures, "sum-frame"));
    let _ = writeln!(text, "| *the localized job*: {} | | {} |", JOB.join(", "), sums(figures, "sum-job"));
    others.for_each(|stage| row(text, stage));
}

fn sums(figures: &Figures, name: &str) -> String {
    let boards = ["cortex-m4", "cortex-m55", "cortex-a53"];
    let sum = |board: &str| figures.get(&format!("{board}.instructions"), name).unwrap_or(0) as f64 / 1000.0;
    boards.map(|board| format!("{:.0} | ", sum(board))).join(" | ")
}

fn rates(figures: &Figures, text: &mut String) {
    *text += "\n## Frames a second\n\nComputed, not measured: clock / (cycles an instruction x the M4's instructions). The cycles an instruction are \
              assumptions for code in zero-wait memory, divisions and square roots (14 cycles) included.\n\n\
              | part | cycles an instruction | whole frame | localized job |\n|---|--:|--:|--:|\n";
    for (part, clock, cycles) in PARTS {
        let rate = |name| clock / cycles / figures.get("cortex-m4.instructions", name).unwrap_or(1).max(1) as f64;
        let _ = writeln!(text, "| {part} | {cycles} | {:.1} | {:.1} |", rate("sum-frame"), rate("sum-job"));
    }
}

fn stack(figures: &Figures, text: &mut String) {
    *text += "\n## Stack\n\nHigh-water mark of each stage, bytes, by painting; 128 and less on the M, 256 and less on the A can't be told apart.\n\n\
              | stage | M4F | M55 | A53 |\n|---|--:|--:|--:|\n";
    for (stage, _) in figures.section("cortex-m4.stack") {
        let bytes = |board: &str| figures.get(&format!("{board}.stack"), stage).unwrap_or(0);
        let _ =
            writeln!(text, "| {stage} | {} | {} | {} |", bytes("cortex-m4"), bytes("cortex-m55"), bytes("cortex-a53"));
    }
    let largest = figures.get("cortex-m4.functions", "largest-stack-frame").unwrap_or(0);
    let _ = writeln!(
        text,
        "\nThe largest frame of a single function on the M4, by the compiler's own count: {largest} bytes."
    );
}

fn memory(figures: &Figures, text: &mut String) {
    *text += "\n## Memory\n\nBytes of what the caller lends, on the M4, by the image's size.\n\n\
              | what | 80x60 | 160x120 | 320x240 | 640x480 |\n|---|--:|--:|--:|--:|\n";
    let sizes = ["80x60", "160x120", "320x240", "640x480"];
    let sized: Vec<&str> = figures.section("memory").filter_map(|(name, _)| name.strip_suffix("-at-160x120")).collect();
    for what in &sized {
        let bytes = sizes.map(|size| figures.get("memory", &format!("{what}-at-{size}")).unwrap_or(0).to_string());
        let _ = writeln!(text, "| {what} | {} |", bytes.join(" | "));
    }
    *text += "\n| of any size | bytes |\n|---|--:|\n";
    for (name, bytes) in figures.section("memory").filter(|(name, _)| !name.contains("-at-")) {
        let _ = writeln!(text, "| {name} | {bytes} |");
    }
}

fn flash(figures: &Figures, text: &mut String) {
    *text += "\n## Flash\n\nCode and constants (`.text` and `.rodata`) of each capability linked alone for the M4, less those of a frame alone.\n\n\
              | capability | bytes |\n|---|--:|\n";
    for (name, bytes) in figures.section("cortex-m4.flash") {
        let _ = writeln!(text, "| {name} | {bytes} |");
    }
}
