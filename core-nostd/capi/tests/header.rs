//! `include/isobath.h` is what cbindgen makes of the sources. `cargo xtask header` (that is, this test with
//! `ISOBATH_WRITE_HEADER` set) writes it anew.

use std::path::Path;

#[test]
fn the_header_is_up_to_date() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = cbindgen::Config::from_file(root.join("cbindgen.toml")).expect("cbindgen.toml");
    let sources = ["types", "status", "memory", "ground", "points", "room", "frames", "context"];
    let mut builder = cbindgen::Builder::new().with_config(config);
    // One by one, in the order in which the header is to be read.
    for name in sources {
        builder = builder.with_src(root.join("src").join(name).with_extension("rs"));
    }
    let mut bytes = Vec::new();
    builder.generate().expect("cbindgen reads the sources").write(&mut bytes);
    // What clippy wants said of unsafe functions, C programmers take for granted.
    let safety = " *\n * # Safety\n * See isobath_init.\n";
    let made = String::from_utf8(bytes).expect("a header is text").replace(safety, "").replace(" * # Safety\n", "");
    let path = root.join("include/isobath.h");
    if std::env::var_os("ISOBATH_WRITE_HEADER").is_some() {
        std::fs::write(&path, made).expect("include/isobath.h can be written");
        return;
    }
    let there = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(made == there, "include/isobath.h is not what the sources say: run `cargo xtask header`");
}
