//! The seed corpora of the fuzz targets, replayed on stable; and the four places that name a target, held together.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use isobath_tests::fuzz::TARGETS;

fn fuzz_dir() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz")
}

fn names_in(dir: &str) -> BTreeSet<String> {
    let entries = fs::read_dir(fuzz_dir().join(dir)).expect(dir);
    entries.map(|e| e.unwrap().path().file_stem().unwrap().to_string_lossy().into_owned()).collect()
}

#[test]
fn every_seed_replays() {
    for (name, body) in TARGETS {
        let dir = fuzz_dir().join("corpus").join(name);
        let mut seeds: Vec<PathBuf> = fs::read_dir(&dir).expect(name).map(|e| e.unwrap().path()).collect();
        seeds.sort();
        assert!(!seeds.is_empty(), "{name} has no seeds");
        for seed in seeds {
            println!("{}", seed.display());
            body(&fs::read(&seed).unwrap());
        }
        body(&[]);
    }
}

#[test]
fn every_target_has_body_wrapper_seeds_and_entry() {
    let bodies: BTreeSet<String> = TARGETS.iter().map(|(name, _)| (*name).to_owned()).collect();
    assert_eq!(bodies.len(), TARGETS.len(), "a name is there twice");
    assert_eq!(names_in("fuzz_targets"), bodies, "fuzz/fuzz_targets");
    assert_eq!(names_in("corpus"), bodies, "fuzz/corpus");
    let manifest = fs::read_to_string(fuzz_dir().join("Cargo.toml")).unwrap();
    for name in bodies {
        assert!(manifest.contains(&format!("name = \"{name}\"")), "fuzz/Cargo.toml lacks {name}");
        let wrapper = fs::read_to_string(fuzz_dir().join("fuzz_targets").join(format!("{name}.rs"))).unwrap();
        let body = name.trim_start_matches("decode_").trim_start_matches("parse_");
        assert!(wrapper.contains(&format!("isobath_tests::fuzz::{body}(")), "{name}.rs calls another body");
    }
}

#[test]
fn seeds_are_few_and_small() {
    for (name, _) in TARGETS {
        let seeds = fs::read_dir(fuzz_dir().join("corpus").join(name)).expect(name);
        let bytes: u64 = seeds.map(|e| e.unwrap().metadata().unwrap().len()).sum();
        assert!(bytes <= 64 * 1024, "{name}: {bytes} bytes of seeds; minimise them (cargo +nightly fuzz cmin)");
    }
}
