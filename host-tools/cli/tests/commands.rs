//! The program as its users meet it: started as a process, on the frame in the clone and on small frames made here.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::atomic::{AtomicUsize, Ordering};

use serde_json::Value;

fn motorcycle() -> String {
    format!("{}/../../data/motorcycle", env!("CARGO_MANIFEST_DIR"))
}

fn isobath(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_isobath")).args(args).output().expect("the program starts")
}

fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).expect("UTF-8")
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).expect("UTF-8")
}

/// Runs a command that must be fine and answer in JSON alone.
fn json(args: &[&str]) -> Value {
    let mut args = args.to_vec();
    args.push("--json");
    let output = isobath(&args);
    assert_eq!(output.status.code(), Some(0), "{args:?}: {}", stderr(&output));
    assert_eq!(stderr(&output), "", "{args:?}");
    serde_json::from_str(&stdout(&output)).unwrap_or_else(|e| panic!("{args:?}: {e}\n{}", stdout(&output)))
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// A folder that goes away by itself.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Self {
        static NEXT: AtomicUsize = AtomicUsize::new(0);
        let name = format!("isobath-cli-{}-{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        let path = std::env::temp_dir().join(name);
        fs::create_dir_all(&path).expect("a folder");
        Self(path)
    }

    fn path(&self, name: &str) -> String {
        self.0.join(name).display().to_string()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// A wall two metres ahead, 64 x 48 pixels, as a 16-bit PGM in millimetres.
fn wall(folder: &Folder, name: &str) -> String {
    let path = folder.path(name);
    let mut file = b"P5\n64 48\n65535\n".to_vec();
    file.extend((0..64 * 48).flat_map(|_| 2000_u16.to_be_bytes()));
    fs::write(&path, file).expect("written");
    path
}

const HAND: [&str; 4] = ["--intrinsics", "60,60,31.5,23.5", "--unit", "0.001"];

#[test]
fn help_teaches() {
    let output = isobath(&["--help"]);
    assert_eq!(output.status.code(), Some(0));
    let text = stdout(&output);
    for command in [
        "run",
        "info",
        "record",
        "convert",
        "devices",
        "sim",
        "normals",
        "points",
        "hit",
        "raycast",
        "measure",
        "place",
        "find-place",
        "path",
        "envmap",
        "probe",
        "bench",
        "completions",
    ] {
        assert!(text.contains(command), "{command}");
        let output = isobath(&["help", command]);
        assert_eq!(output.status.code(), Some(0), "{command}");
        assert!(stdout(&output).contains(&format!("isobath {command}")), "{command}");
    }
    assert!(text.contains("Exit codes"));
}

#[test]
fn a_simulated_recording_is_read_back_and_needs_no_files() {
    let folder = Folder::new();
    let out = folder.path("wall");
    let args = ["sim", "wall", "--frames", "2", "--size", "64x48", "--environment", "0", "--out", &out];
    let written = json(&args);
    assert_eq!((&written["scene"], &written["frames"]), (&Value::from("wall"), &Value::from(2)));
    // The wall stands 2 m away; written in 1/5000 m steps.
    let from_file = json(&["hit", &out, "--pixel", "32,24"]);
    let from_scene = json(&["hit", "sim:wall", "--size", "64x48", "--pixel", "32,24"]);
    for hit in [&from_file, &from_scene] {
        assert_eq!(hit["answer"], "hit");
        assert!((number(&hit["point_m"][2]) + 2.0).abs() < 2e-4, "{hit}");
    }
    let noisy = json(&["info", "sim:desk@kinect-full", "--size", "64x48"]);
    assert!(number(&noisy["readings_share"]) < 1.0, "a full Kinect has holes");
    let output = isobath(&["info", "sim:nowhere"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("living-room"), "the scenes there are are named");
    let output = isobath(&["sim", "wall", "--sensor", "sonar", "--out", &out]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("kinect"), "{}", stderr(&output));
}

#[test]
fn what_sim_writes_run_reads() {
    let folder = Folder::new();
    let out = folder.path("living");
    let written = json(&[
        "sim",
        "living-room",
        "--frames",
        "2",
        "--size",
        "160x120",
        "--sensor",
        "kinect",
        "--seed",
        "3",
        "--environment",
        "32",
        "--probe",
        "0.2,1,-0.4",
        "--path",
        "shake",
        "--tracking",
        "phone",
        "--imu",
        "phone",
        "--colour-size",
        "320x180",
        "--lens=-0.1,0.02,0,0,0,0,0,0",
        "--unit",
        "0.001",
        "--out",
        &out,
    ]);
    assert_eq!(written["environment_maps"], 11, "ten places of the scene, and the one asked for");
    assert_eq!(written["imu_samples"], 7, "33 ms at 200 a second");
    let at = |name: &str| Path::new(&out).join(name);
    for name in ["truth/environment/probe-1.exr", "truth/radiance-000001.exr", "truth/depth-000000.npy", "reported.txt"]
    {
        assert!(at(name).is_file(), "{name}");
    }
    assert!(fs::read_to_string(at("camera.toml")).expect("a camera").contains("distortion"));
    let report = folder.path("report");
    let run = json(&["run", &out, "--out", &report]);
    assert_eq!((&run["frames"], &run["has_poses"]), (&Value::from(2), &Value::from(true)));
    assert!(Path::new(&report).join("report.html").is_file());
    let facets = json(&["hit", "sim:facets-easy", "--pixel", "200,190"]);
    assert!(number(&facets["point_m"][2]).abs() < 200.0 && facets["answer"] == "hit", "{facets}");
    let output = isobath(&["sim", "wall", "--path", "fly", "--out", &out]);
    assert!(output.status.code() == Some(1) && stderr(&output).contains("stations"), "{}", stderr(&output));
}

#[test]
fn completions_for_every_shell() {
    for shell in ["bash", "zsh", "fish"] {
        let output = isobath(&["completions", shell]);
        assert_eq!(output.status.code(), Some(0));
        assert!(stdout(&output).contains("find-place"), "{shell}");
    }
}

#[test]
fn bad_usage_is_two_and_failure_is_one() {
    let m = motorcycle();
    for args in [
        vec![],
        vec!["fly"],
        vec!["hit", &m],
        vec!["hit", &m, "--pixel", "1"],
        vec!["hit", &m, "--pixel", "1,x"],
        vec!["raycast", &m, "--from", "0,0,0", "--dir", "0,0"],
        vec!["measure", &m, "--pixels", "1,2"],
        vec!["hit", &m, "--pixel", "1,2", "--intrinsics", "1,2,3,4"],
        vec!["points", &m, "--out", "x.obj"],
        vec!["envmap", &m, "--at", "0,0,1", "--out", "x.jpg"],
        vec!["envmap", &m, "--out", "x.exr"],
        vec!["probe", &m],
        vec!["probe", "--at", "0,0,1"],
        vec!["probe", &m, "--at", "0,0,1", "--map", "x.exr"],
        vec!["probe", "--map", "x.exr", "--out", "balls.jpg"],
    ] {
        let output = isobath(&args);
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        assert_eq!(stdout(&output), "", "{args:?}");
    }
    for args in [
        vec!["hit", "/nowhere", "--pixel", "1,2"],
        vec!["hit", &m, "--pixel", "1,2", "--frame", "7"],
        vec!["raycast", &m, "--from", "0,0,0", "--dir", "0,0,0"],
        vec!["raycast", &m, "--from", "0,0,0", "--dir", "0,0,1", "--world"],
        vec!["normals", &m, "--out", "/nowhere/at/all.npy"],
        vec!["hit", &m, "--pixel", "1,2", "--up", "0,0,0"],
        vec!["envmap", &m, "--at", "0,0,1", "--out", "x.exr"],
        vec!["envmap", "sim:wall", "--size", "32x24", "--at", "0,1,0", "--guided", "4", "--out", "x.exr"],
        vec!["envmap", "sim:wall", "--size", "32x24", "--at", "0,1,0", "--out", "/nowhere/at/all.exr"],
        vec!["probe", "--map", "/nowhere.exr"],
        vec!["probe", "--map", &m],
    ] {
        let output = isobath(&args);
        assert_eq!(output.status.code(), Some(1), "{args:?}");
        assert_eq!(stdout(&output), "", "{args:?}");
        let text = stderr(&output);
        assert!(text.starts_with("error: ") && text.contains("where: ") && text.contains("what to do: "), "{text}");
    }
}

#[test]
fn errors_for_machines_are_json_too() {
    for (args, code) in [(["hit", "/nowhere", "--pixel", "1,2", "--json"].as_slice(), 1), (&["hit", "--json"], 2)] {
        let output = isobath(args);
        assert_eq!(output.status.code(), Some(code));
        let value: Value = serde_json::from_str(&stderr(&output)).expect("JSON");
        for field in ["what", "where", "what_to_do"] {
            assert!(value["error"][field].is_string(), "{field}");
        }
    }
}

#[test]
fn piped_output_is_plain_and_narrow() {
    let m = motorcycle();
    let folder = Folder::new();
    let (out, map) = (folder.path("report"), folder.path("map.exr"));
    for args in [
        vec!["info", &m],
        vec!["hit", &m, "--pixel", "370,250"],
        vec!["raycast", &m, "--from", "0,0,0", "--dir", "0,0,1"],
        vec!["measure", &m, "--pixels", "200,250", "520,260"],
        vec!["place", &m, "--box", "0,0.6,2.6,0.5,0.9,0.5"],
        vec!["path", &m, "--from", "0,1,2", "--to", "0,1,3"],
        vec!["run", &m, "--out", &out, "--repeat", "1"],
        vec!["envmap", "sim:sphere", "--size", "32x24", "--at", "0,0.3,0", "--guided", "3", "--out", &map],
        vec!["probe", "--map", &map],
    ] {
        let output = isobath(&args);
        assert_eq!(output.status.code(), Some(0), "{args:?}");
        assert_eq!(stderr(&output), "", "{args:?}: nothing but the answer");
        for line in stdout(&output).lines() {
            assert!(!line.contains('\x1b'), "{line:?}");
            // Paths are as long as they are.
            assert!(line.chars().count() <= 80 || line.contains('/'), "{line:?}");
        }
    }
}

#[test]
fn a_wall_is_hit_where_it_stands() {
    let folder = Folder::new();
    let src = wall(&folder, "wall.pgm");
    let ask = |rest: &[&str]| {
        let mut args = vec![rest[0], &src];
        args.extend(&rest[1..]);
        args.extend(HAND);
        json(&args)
    };
    let hit = ask(&["hit", "--pixel", "31.5,23.5"]);
    assert_eq!(hit["answer"], "hit");
    assert!((number(&hit["z_m"]) - 2.0).abs() < 1e-6);
    assert!((number(&hit["normal"][2]) + 1.0).abs() < 1e-5);
    assert_eq!(ask(&["hit", "--pixel", "64,0"])["answer"], "outside_view");

    let ray = ask(&["raycast", "--from", "-0.3,0,0.5", "--dir", "0.2,0,1"]);
    assert_eq!(ray["answer"], "hit");
    assert!((number(&ray["point_m"][0])).abs() < 1e-4 && (number(&ray["point_m"][2]) - 2.0).abs() < 1e-4, "{ray}");

    let length = ask(&["measure", "--pixels", "16.5,23.5", "46.5,23.5"]);
    assert!((number(&length["distance_m"]) - 1.0).abs() < 1e-3, "{length}");

    assert_eq!(ask(&["place", "--box", "0,0,1.2,0.4,0.4,0.4", "--yaw", "20"])["answer"], "free");
    assert_eq!(ask(&["place", "--box", "0,0,2.5,0.4,0.4,0.4"])["answer"], "blocked");
    assert_eq!(ask(&["place", "--box", "0,0,-2,0.4,0.4,0.4"])["answer"], "unknown");
    assert_eq!(ask(&["find-place", "--size", "0.3,0.3,0.3"])["answer"], "none");
    // The wall as the floor of a camera that looks straight down.
    let down = ask(&["find-place", "--size", "0.3,0.3,0.3", "--up", "0,0,-1"]);
    assert_eq!(down["answer"], "found");
    assert!((number(&down["places"][0]["centre_m"][2]) - 1.85).abs() < 1e-3, "{down}");
    let walk = ask(&["path", "--from", "-0.4,0,1", "--to", "0.4,0.1,1", "--up", "0,0,-1"]);
    assert_eq!(walk["answer"], "path");
    assert!((number(&walk["length_m"]) - 0.8).abs() < 0.1, "{walk}");
    assert_eq!(ask(&["path", "--from", "-30,0,1", "--to", "0.4,0,1", "--up", "0,0,-1"])["answer"], "start_outside");
}

#[test]
fn limits_make_holes() {
    let folder = Folder::new();
    let src = wall(&folder, "wall.pgm");
    let mut args = vec!["hit", &src, "--pixel", "30,20", "--max-z", "1.5"];
    args.extend(HAND);
    assert_eq!(json(&args)["answer"], "no_depth");
}

#[test]
fn arrays_have_the_promised_shape() {
    let folder = Folder::new();
    let src = wall(&folder, "wall.pgm");
    for command in ["normals", "points"] {
        let out = folder.path(&format!("{command}.npy"));
        let mut args = vec![command, &src, "--out", &out];
        args.extend(HAND);
        json(&args);
        let file = fs::read(&out).expect("the array");
        assert_eq!(&file[..8], b"\x93NUMPY\x01\x00");
        let length = usize::from(u16::from_le_bytes([file[8], file[9]]));
        let header = String::from_utf8_lossy(&file[10..10 + length]).into_owned();
        assert!(header.contains("'<f4'") && header.contains("(48, 64, 3)"), "{header}");
        assert_eq!(file.len(), 10 + length + 48 * 64 * 3 * 4);
        let last = f32::from_le_bytes(file[file.len() - 4..].try_into().expect("four bytes"));
        let want = if command == "normals" { -1.0 } else { 2.0 };
        assert!((last - want).abs() < 1e-5, "{command}: {last}");
    }
}

#[test]
fn pictures_and_clouds_are_written() {
    let (m, folder) = (motorcycle(), Folder::new());
    let (png, ply) = (folder.path("n.png"), folder.path("p.ply"));
    let normals = json(&["normals", &m, "--png", &png, "--method", "paper"]);
    assert_eq!(normals["method"], "paper");
    assert!(fs::read(&png).expect("the picture").starts_with(b"\x89PNG"));
    let points = json(&["points", &m, "--out", &ply]);
    let n = usize::try_from(points["points"].as_u64().expect("a count")).expect("small");
    assert!(n > 300_000 && points["colour"] == true);
    let file = fs::read(&ply).expect("the cloud");
    let head = file.windows(11).position(|w| w == b"end_header\n").expect("a header") + 11;
    assert_eq!(file.len() - head, n * 15);
}

#[test]
fn the_first_run_shows_something_true() {
    let (m, folder) = (motorcycle(), Folder::new());
    let out = folder.path("report");
    let answer = json(&["run", &m, "--out", &out, "--repeat", "2"]);
    let found = &answer["results"][0];
    assert_eq!(found["ground"]["answer"], "ground");
    assert!(number(&found["ground"]["rms_m"]) < 0.02);
    assert_eq!(found["reticle"]["answer"], "hit");
    // The middle of the image is the motorcycle's engine.
    assert!((2.1..2.6).contains(&number(&found["reticle"]["z_m"])), "{}", found["reticle"]);
    assert_eq!(found["path"]["answer"], "path");
    assert!(number(&found["path"]["length_m"]) > number(&found["path"]["straight_m"]), "it goes around something");
    assert!(number(&found["placement"]["chairs_free"]) > 0.0 && number(&found["placement"]["chairs_blocked"]) > 0.0);
    assert_eq!(answer["passes_per_frame"], 2);
    let light = &found["light"];
    assert!(
        light["answer"] == "light" && number(&light["near_points"]) > 1000.0 && number(&light["near_share"]) > 0.1,
        "{light}"
    );
    for stage in ["pyramid", "normals", "path", "light", "all_stages", "read"] {
        assert!(number(&answer["times"][stage]["median_ns"]) > 0.0, "{stage}");
    }
    let file: Value =
        serde_json::from_slice(&fs::read(Path::new(&out).join("report.json")).expect("a report")).expect("JSON");
    assert_eq!(file["results"], answer["results"]);
    let page = fs::read_to_string(Path::new(&out).join("report.html")).expect("a report");
    for (what, said) in
        [("a script", "<script"), ("a link", "<link"), ("a font", "@import"), ("a net address", "src=\"http")]
    {
        assert!(!page.contains(said), "{what}");
    }
    assert!(page.contains("data:image/png;base64,") && page.trim_end().ends_with("</html>"));
}

#[test]
fn recordings_without_anything_to_find_still_give_a_report() {
    let folder = Folder::new();
    // A wall: no ground, no path. And an image of nothing but holes.
    let src = wall(&folder, "wall.pgm");
    let holes = folder.path("holes.pgm");
    let mut file = b"P5\n7 5\n65535\n".to_vec();
    file.extend([0; 7 * 5 * 2]);
    fs::write(&holes, file).expect("written");
    for src in [&src, &holes] {
        let out = folder.path("out");
        let mut args = vec!["run", src, "--out", &out];
        args.extend(HAND);
        let answer = json(&args);
        assert_eq!(answer["results"][0]["ground"]["answer"], "no_ground");
        assert_ne!(answer["results"][0]["path"]["answer"], "path");
        assert!(Path::new(&out).join("report.html").exists());
    }
}

#[test]
fn every_field_is_documented() {
    let readme = include_str!("../README.md");
    let row = |command: &str| {
        let start = format!("| `{command}` |");
        readme.lines().find(|l| l.starts_with(&start)).unwrap_or_else(|| panic!("{command} has a row")).to_owned()
    };
    let (m, folder) = (motorcycle(), Folder::new());
    let (out, npy, map) = (folder.path("report"), folder.path("n.npy"), folder.path("map.exr"));
    for args in [
        vec!["info", &m],
        vec!["normals", &m, "--out", &npy],
        vec!["points", &m, "--out", &npy],
        vec!["hit", &m, "--pixel", "370,250"],
        vec!["raycast", &m, "--from", "0,0,0", "--dir", "0.1,0.2,1"],
        vec!["measure", &m, "--pixels", "200,250", "520,260"],
        vec!["place", &m, "--box", "0,0.6,2.6,0.5,0.9,0.5"],
        vec!["find-place", &m, "--size", "0.3,0.4,0.3"],
        vec!["path", &m, "--from", "0.15,0.54,2.17", "--to", "-1,0.25,3.25"],
        vec!["envmap", "sim:sphere", "--size", "32x24", "--at", "0,0.3,0", "--preset", "tiny", "--out", &map],
        vec!["probe", "--map", &map],
        vec!["run", &m, "--out", &out, "--repeat", "1"],
    ] {
        let answer = json(&args);
        let row = row(args[0]);
        for field in answer.as_object().expect("an object").keys() {
            let common = ["command", "source", "frame"].contains(&field.as_str());
            assert!(common || row.contains(&format!("`{field}`")), "{}: {field}", args[0]);
        }
        if args[0] == "path" {
            assert_eq!(answer["answer"], "path", "the example of the help is one");
        }
        if args[0] == "run" {
            let results = readme.split_once("One of `run`'s").expect("a table").1;
            for field in answer["results"][0].as_object().expect("an object").keys() {
                assert!(results.contains(&format!("`{field}`")), "results: {field}");
            }
        }
    }
}

/// Four frames of a floor seen from 1.5 m above, the camera moving along x by 0.6 m a frame; frame 2 is cut off.
fn walk_over_a_floor(folder: &Folder) -> String {
    let depth = folder.0.join("walk/depth");
    fs::create_dir_all(&depth).expect("a folder");
    let mut poses = String::new();
    for i in 0..4 {
        let mut file = b"P5\n64 48\n65535\n".to_vec();
        file.extend((0..64 * 48).flat_map(|_| 1500_u16.to_be_bytes()));
        file.truncate(if i == 2 { 100 } else { usize::MAX });
        fs::write(depth.join(format!("{i:05}.pgm")), file).expect("written");
        poses.push_str(&format!("{} 0 0 0 0 0 1\n", 0.6 * f64::from(i)));
    }
    fs::write(folder.0.join("walk/pose.txt"), poses).expect("written");
    let camera = "fx = 50\nfy = 50\ncx = 31.5\ncy = 23.5\nup = [0, 0, -1]\n[depth]\nunit = 0.001\n";
    fs::write(folder.0.join("walk/camera.toml"), camera).expect("written");
    folder.path("walk")
}

#[test]
fn frames_with_poses_share_one_world() {
    let folder = Folder::new();
    let src = walk_over_a_floor(&folder);
    let out = folder.path("report");

    let answer = json(&["run", &src, "--out", &out]);
    assert_eq!(answer["frames"], 4);
    assert_eq!(answer["shown_frame"], 3);
    let results = answer["results"].as_array().expect("a list");
    assert_eq!(results.len(), 3, "the broken frame is left out");
    assert!(answer["notes"].to_string().contains("frame 2 left out"), "{}", answer["notes"]);
    assert!((number(&results[0]["ground"]["camera_height_m"]) - 1.5).abs() < 1e-3);
    let known = |i: usize| number(&results[i]["height_map"]["known_cells"]);
    assert!(known(0) < known(1) && known(1) < known(2), "the map grows as the camera moves");
    assert!(number(&results[2]["path"]["length_m"]) > number(&results[0]["path"]["length_m"]));

    // The camera of frame 3 stands at x = 1.8.
    let hit = json(&["hit", &src, "--frame", "3", "--pixel", "31.5,23.5"]);
    assert!((number(&hit["point_m"][0]) - 1.8).abs() < 1e-5 && number(&hit["camera_point_m"][0]).abs() < 1e-5, "{hit}");
    let down = ["--from", "1.8,0,0.2", "--dir", "0,0,1"];
    let world = json(&[&["raycast", &src, "--frame", "3", "--world"], &down[..]].concat());
    assert!(world["answer"] == "hit" && (number(&world["point_m"][2]) - 1.5).abs() < 1e-5, "{world}");
    assert_eq!(
        json(&[&["raycast", &src, "--frame", "3", "--reach", "1.5"], &down[..]].concat())["answer"],
        "outside_view"
    );

    // From under the first camera to under the last: one frame does not see that far, all together do.
    let ends = ["--from", "-0.5,0,1.5", "--to", "2.3,0,1.5"];
    let alone = json(&[&["path", &src, "--frame", "1"], &ends[..]].concat());
    assert_eq!(alone["answer"], "start_unknown");
    let joined = json(&[&["path", &src, "--frame", "3", "--all"], &ends[..]].concat());
    assert!(joined["answer"] == "path" && joined["frames_left_out"] == 1, "{joined}");
    let both = ["--from", "-0.5,0,1.5", "--to", "1.2,0,1.5"];
    let joined = json(&[&["path", &src, "--frame", "1", "--all"], &both[..]].concat());
    assert!(joined["answer"] == "path" && (number(&joined["length_m"]) - 1.7).abs() < 0.1, "{joined}");

    let npy = folder.path("p.npy");
    assert_eq!(json(&["points", &src, "--frame", "3", "--world", "--out", &npy])["space"], "world");
    let broken = isobath(&["hit", &src, "--frame", "2", "--pixel", "1,1"]);
    assert_eq!(broken.status.code(), Some(1));
    assert!(stderr(&broken).contains("00002.pgm"), "{}", stderr(&broken));
}

#[test]
fn the_light_of_a_place_from_files_and_back() {
    let folder = Folder::new();
    let (src, map, balls) = (folder.path("room"), folder.path("map.exr"), folder.path("balls.png"));
    let drifting = folder.path("drifting");
    let at = "--at=-0.35,0.53,-0.5";
    let orbit = ["--path", "orbit", "--place", "table", "--environment", "64", "--out", &src];
    json(&[&["sim", "living-room", "--frames", "30", "--size", "64x48"], &orbit[..]].concat());
    let answer = json(&["envmap", &src, at, "--guided", "5", "--out", &map]);
    assert_eq!((&answer["preset"], &answer["width"], &answer["height"]), (&"low".into(), &512.into(), &256.into()));
    // A second of walking round: some frames are new, most are not; all see the table, none looks away from it.
    assert_eq!(answer["frames_offered"], 30);
    let taken = number(&answer["frames"]);
    assert!((2.0..12.0).contains(&taken) && answer["near_frames"] == answer["frames"], "{answer}");
    assert_eq!(answer["near_views_kept"], number(&answer["frames"]).min(3.0) as u64);
    assert!(answer["guided"]["seen"] == 0 && answer["guided"]["next"]["yaw_rad"].is_number(), "{answer}");
    assert!(number(&answer["near_share"]) > 0.2 && number(&answer["anchors_seen"]) > 100.0, "{answer}");
    let every = json(&["envmap", &src, at, "--all", "--preset", "tiny", "--out", &folder.path("all.hdr")]);
    assert_eq!((&every["frames"], &every["not_taken_not_new"]), (&30.into(), &0.into()));
    assert!(every["memory_bytes"].as_object().expect("parts").values().map(number).sum::<f64>() < 256.0 * 1024.0);

    let orbit =
        ["--path", "orbit", "--place", "table", "--tracking", "phone", "--environment", "0", "--out", &drifting];
    json(&[&["sim", "living-room", "--frames", "45", "--size", "160x120"], &orbit[..]].concat());
    let registered = json(&["envmap", &drifting, at, "--register", "--out", &folder.path("r.exr")]);
    let r = &registered["registration"];
    assert!(number(&r["runs"]) >= 1.0 && number(&r["corrected"]) >= 1.0, "{r}");
    assert!((1e-5..0.1).contains(&number(&r["largest_shift_m"])), "{r}");

    // The file says what the session said; the truth beside the recording is not far.
    let probe = json(&["probe", "--map", &map, "--out", &balls]);
    let coefficient = |answer: &Value, k: usize| number(&answer["harmonics"]["coefficients"][k][1]);
    for k in 0..9 {
        assert!((coefficient(&probe, k) - coefficient(&answer, k)).abs() < 1e-4, "{k}");
    }
    assert!(fs::read(&balls).expect("a picture").starts_with(b"\x89PNG"));
    let truth = format!("{src}/truth/environment/table.exr");
    let truth = json(&["probe", "--map", &truth]);
    let (ours, exact) = (coefficient(&probe, 0), coefficient(&truth, 0) * 0.85);
    assert!((0.4..2.5).contains(&(ours / exact)), "the mean light: {ours} {exact}");
    let same = json(&["probe", &src, at]);
    assert!((coefficient(&same, 4) - coefficient(&answer, 4)).abs() < 1e-6);
    // Without a place in view there is light from afar alone.
    let elsewhere = json(&["envmap", &src, "--at", "50,1,0", "--preset", "tiny", "--out", &folder.path("x.png")]);
    assert!(elsewhere["near_frames"] == 0 && number(&elsewhere["far_samples"]) > 0.0, "{elsewhere}");
}

#[test]
fn maps_turn_with_the_worlds_up() {
    let folder = Folder::new();
    let light = |up: &str| {
        let map = folder.path("map.exr");
        json(&[
            "envmap",
            "sim:sphere",
            "--size",
            "64x48",
            "--at",
            "0,0.4,0",
            "--preset",
            "tiny",
            "--up",
            up,
            "--out",
            &map,
        ])
    };
    let (upright, upside_down) = (light("0,1,0"), light("0,-1,0"));
    // Light's vertical part changes its sign in the map's axes, and is the same in the world's.
    let vertical = |answer: &Value| number(&answer["harmonics"]["coefficients"][1][1]);
    assert!(vertical(&upright) * vertical(&upside_down) < 0.0);
    let world = |answer: &Value| number(&answer["harmonics"]["main_light"]["direction"][1]);
    assert!((world(&upright) - world(&upside_down)).abs() < 0.1, "{upright} {upside_down}");
}

#[test]
fn what_has_no_light_says_what_is_missing() {
    let (m, folder) = (motorcycle(), Folder::new());
    let src = wall(&folder, "wall.pgm");
    for (mut args, what) in
        [(vec!["envmap", m.as_str()], "no poses"), (vec!["envmap", &src], "neither colour nor poses")]
    {
        args.extend(["--at", "0,0,1", "--out", "x.exr"]);
        if args[1] == src {
            args.extend(HAND);
        }
        let output = isobath(&args);
        assert_eq!(output.status.code(), Some(1), "{args:?}");
        assert!(stderr(&output).contains(what) && stderr(&output).contains("sim:living-room"), "{}", stderr(&output));
    }
}

#[test]
fn the_bench_says_how_long_and_how_wrong() {
    let folder = Folder::new();
    let out = folder.path("bench");
    let args = ["bench", "--quick", "--filter", "pyramid", "--size", "64x48", "--out", &out];
    let text = stdout(&isobath(&args));
    assert!(
        text.contains("PYRAMID")
            && text.contains("ns/pixel")
            && text.lines().all(|l| l.starts_with("wrote") || l.chars().count() <= 80)
    );
    for file in ["bench.html", "bench.csv", "bench.json"] {
        assert!(fs::metadata(Path::new(&out).join(file)).is_ok_and(|m| m.len() > 100), "{file}");
    }
    let answer = json(&args);
    let results = answer["results"].as_array().expect("results");
    assert_eq!(results.len(), 6, "three scenes, two sensors");
    assert!(results.iter().all(|r| number(&r["errors"]["wrong_per_1000"]) == 0.0 && number(&r["best_ns"]) > 0.0));
    let refused = isobath(&["bench", "--filter", "nonsense"]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(stderr(&refused).contains("raycast"), "{}", stderr(&refused));
    let refused = isobath(&["bench", "--filter", "pyramid", "--peers", "/nowhere"]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(stderr(&refused).contains("cargo xtask peers"), "{}", stderr(&refused));
}

#[test]
fn recordings_are_converted_without_losing_a_bit_and_answer_as_before() {
    let folder = Folder::new();
    let (desk, mcap, tum) = (folder.path("desk"), folder.path("desk.mcap"), folder.path("tum"));
    json(&["sim", "desk", "--frames", "4", "--size", "64x48", "--environment", "0", "--out", &desk]);
    let recorded = json(&["record", &desk, "--out", &mcap]);
    assert_eq!((&recorded["frames"], &recorded["lossless"]), (&Value::from(4), &Value::from(true)));
    assert!(number(&recorded["imu_samples"]) > 10.0, "the folder's imu.csv comes along: {recorded}");
    let converted = json(&["convert", &mcap, "--out", &tum]);
    assert_eq!((&converted["lossless"], &converted["frames"]), (&Value::from(true), &Value::from(4)));
    let first = json(&["hit", &desk, "--pixel", "30,20", "--frame", "3"]);
    for src in [mcap.clone(), format!("mcap:{mcap}"), tum] {
        let info = json(&["info", &src]);
        assert_eq!(
            (&info["frames"], &info["has_pose"], &info["unit_m"]),
            (&Value::from(4), &Value::from(true), &Value::from(0.0002))
        );
        assert_eq!(
            (&info["imu"]["readings"], &info["up"]["from"]),
            (&recorded["imu_samples"], &Value::from("recording"))
        );
        let hit = json(&["hit", &src, "--pixel", "30,20", "--frame", "3"]);
        for field in ["z_m", "answer", "support"] {
            assert_eq!(hit[field], first[field], "{src} {field}");
        }
    }
    // Depth alone in text, 80 columns; and part of a recording.
    let text = stdout(&isobath(&["info", &mcap]));
    assert!(text.contains("readings at 200 Hz") && text.lines().skip(1).all(|l| l.chars().count() <= 80), "{text}");
    let part = json(&["convert", &mcap, "--out", &folder.path("part.mcap"), "--seconds", "0.05"]);
    assert_eq!(part["frames"], 2, "frames at 0 and 33 ms");
    let report = folder.path("report");
    assert_eq!(json(&["run", &mcap, "--out", &report, "--frames", "2"])["frames"], 2);
}

#[test]
fn recordings_are_never_overwritten_and_losses_are_said() {
    let folder = Folder::new();
    let file = folder.path("a.mcap");
    json(&["convert", &motorcycle(), "--out", &file]);
    let before = fs::read(&file).expect("written");
    let output = isobath(&["record", &motorcycle(), "--out", &file]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("never overwritten"), "{}", stderr(&output));
    assert_eq!(fs::read(&file).expect("there"), before);
    // Its unit is none of TUM's steps.
    let tum = json(&["convert", &motorcycle(), "--out", &folder.path("tum")]);
    assert_eq!(tum["lossless"], false);
    assert!(tum["notes"].to_string().contains("rounded"), "{tum}");
    for (args, word) in [
        (vec!["record", "x", "--out", "x.bag"], "must end in .mcap"),
        (vec!["convert", "x", "--out", "x.bag"], "TUM RGB-D folders"),
        (vec!["record", "x", "--out", "x.mcap", "--seconds", "0"], "positive"),
    ] {
        let output = isobath(&args);
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        assert!(stderr(&output).contains(word), "{args:?}: {}", stderr(&output));
    }
}

#[test]
fn devices_are_listed_and_what_is_missing_is_said() {
    let devices = json(&["devices"]);
    assert!(devices["devices"].is_array() && devices["live"].is_boolean());
    let text = stdout(&isobath(&["devices"]));
    assert!(text.lines().all(|l| l.chars().count() <= 80), "{text}");
    if devices["live"] == false {
        assert!(text.contains("--features live"), "{text}");
        for src in ["v4l2:/dev/video0", "usb:kinect"] {
            let output = isobath(&["info", src]);
            assert_eq!(output.status.code(), Some(1), "{src}");
            assert!(stderr(&output).contains("--features live"), "{}", stderr(&output));
        }
        let output = isobath(&["record", "usb:kinect", "--out", "never.mcap"]);
        assert!(output.status.code() == Some(1) && !Path::new("never.mcap").exists());
    }
    let output = isobath(&["info", &format!("bag:{}/depth.png", motorcycle())]);
    assert_eq!(output.status.code(), Some(1));
}

/// Ctrl-C ends a recording with a whole file, however far it was.
#[cfg(unix)]
#[test]
fn an_interrupted_recording_is_whole() {
    let folder = Folder::new();
    let file = folder.path("long.mcap");
    let source = folder.path("source");
    json(&["sim", "desk", "--frames", "12", "--size", "320x240", "--environment", "0", "--out", &source]);
    let mut child = Command::new(env!("CARGO_BIN_EXE_isobath"))
        .args(["record", &source, "--out", &file, "--json"])
        .stdout(std::process::Stdio::piped())
        .spawn()
        .expect("started");
    // It has begun when its file has something in it.
    while fs::metadata(&file).map_or(0, |m| m.len()) < 1000 && child.try_wait().expect("waited").is_none() {
        std::thread::yield_now();
    }
    let _ = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    let output = child.wait_with_output().expect("ended");
    assert_eq!(output.status.code(), Some(0), "an end that was asked for is no failure");
    let said: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let info = json(&["info", &file]);
    assert_eq!(info["frames"], said["frames"]);
    assert!(
        info["notes"].as_array().is_some_and(|notes| !notes.iter().any(|n| n.to_string().contains("cut off"))),
        "{info}"
    );
}
