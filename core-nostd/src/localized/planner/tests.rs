use super::*;
use crate::localized::height_map::{Grid, HeightCell, HeightMapParams};
use proptest::prelude::*;
use std::vec;
use std::vec::Vec;

/// A map from ASCII art: `.` floor, `#` a metre high, `?` unknown, `0`-`9` tenths of a metre.
fn cells(art: &[&str]) -> (usize, usize, Vec<Option<f32>>) {
    let all = art.iter().flat_map(|r| r.bytes()).map(|b| match b {
        b'#' => Some(1.0),
        b'?' => None,
        b'0'..=b'9' => Some(f32::from(b - b'0') * 0.1),
        _ => Some(0.0),
    });
    (art[0].len(), art.len(), all.collect())
}

fn with_map<R>(w: usize, d: usize, heights: &[Option<f32>], cell: f32, f: impl FnOnce(&mut HeightMap<'_>) -> R) -> R {
    let grid = Grid::new(Vec3::ZERO, Vec3::Y, Vec3::NEG_Z, cell, w, d).unwrap();
    let mut storage = vec![HeightCell::UNKNOWN; w * d];
    let mut map = HeightMap::new(grid, &mut storage, HeightMapParams::DEFAULT).unwrap();
    for (i, h) in heights.iter().enumerate() {
        let h = h.unwrap_or(f32::NAN);
        map.set(i % w, i / w, h, h);
    }
    f(&mut map)
}

const THIN: Walker = Walker { radius: 0.0, ..Walker::DEFAULT };

fn plan_on(map: &HeightMap<'_>, walker: &Walker, a: (usize, usize), b: (usize, usize)) -> (Plan, Vec<Vec3>, Vec<Node>) {
    let mut nodes = vec![Node::EMPTY; map.grid().cells()];
    let mut points = vec![Vec3::ZERO; 512];
    let (a, b) = (map.grid().point_of(a.0, a.1, 0.0), map.grid().point_of(b.0, b.1, 0.0));
    let plan = Planner::new(&mut nodes).plan(map, walker, a, b, &mut points).unwrap();
    if let Plan::Found(p) = plan {
        points.truncate(p.points);
    }
    (plan, points, nodes)
}

fn plan_art(art: &[&str], walker: &Walker, a: (usize, usize), b: (usize, usize)) -> Plan {
    let (w, d, heights) = cells(art);
    with_map(w, d, &heights, 0.1, |map| plan_on(map, walker, a, b).0)
}

/// Dijkstra by plain relaxation until nothing changes, f64.
fn oracle(map: &HeightMap<'_>, nodes: &[Node], climb: f64, start: usize, goal: usize) -> f64 {
    let (w, d) = map.grid().size();
    let cell = f64::from(map.grid().cell());
    let mut cost = vec![f64::INFINITY; w * d];
    cost[start] = 0.0;
    let free = |x: i32, y: i32| {
        x >= 0 && y >= 0 && x < w as i32 && y < d as i32 && nodes[y as usize * w + x as usize].walkable()
    };
    let mean = |i: usize| map.cells()[i].is_known().then(|| f64::from(map.cells()[i].mean));
    loop {
        let mut moved = false;
        for i in 0..w * d {
            let (x, y) = ((i % w) as i32, (i / w) as i32);
            if !free(x, y) {
                continue;
            }
            for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
                if !free(x + dx, y + dy) || !free(x + dx, y) || !free(x, y + dy) {
                    continue;
                }
                let j = (y + dy) as usize * w + (x + dx) as usize;
                let rise = mean(i).zip(mean(j)).map_or(0.0, |(a, b)| (a - b).abs());
                let c = cost[i] + cell * f64::from(dx * dx + dy * dy).sqrt() + climb * rise;
                if c < cost[j] - 1e-12 {
                    cost[j] = c;
                    moved = true;
                }
            }
        }
        if !moved {
            return cost[goal];
        }
    }
}

/// Whether the disc of cells' middles within the radius, along the whole path, is free of raw obstacles.
fn keeps_clear(map: &HeightMap<'_>, points: &[Vec3], nodes: &[Node], radius: f32) -> bool {
    let (w, d) = map.grid().size();
    let flat = |p: Vec3| p - map.grid().up() * map.grid().height_of(p);
    points.windows(2).all(|s| {
        (0..=200).all(|i| {
            let p = flat(s[0].lerp(s[1], i as f32 / 200.0));
            (0..w * d).all(|j| {
                !nodes[j].is(Node::OBSTACLE)
                    || flat(map.grid().point_of(j % w, j / w, 0.0)).distance(p) >= radius - 0.5 * map.grid().cell()
            })
        })
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn as_cheap_as_dijkstra_and_smoothing_is_valid(
        w in 1_usize..22, d in 1_usize..22, seed in 1_u32.., radius in 0.0_f32..0.16, climb in 0.0_f32..3.0, policy in 0_usize..3,
    ) {
        let mut s = seed;
        let mut next = || { s ^= s << 13; s ^= s >> 17; s ^= s << 5; s };
        let heights: Vec<Option<f32>> = (0..w * d).map(|_| match next() % 12 {
            0 => Some(1.0), 1 => None, n => Some(n as f32 * 0.01),
        }).collect();
        let policy = [HolePolicy::Unknown, HolePolicy::Solid, HolePolicy::Free][policy];
        let walker = Walker { radius, climb_cost: climb, unknown: policy, ..Walker::DEFAULT };
        let (a, b) = (next() as usize % (w * d), next() as usize % (w * d));
        with_map(w, d, &heights, 0.1, |map| {
            let (plan, points, nodes) = plan_on(map, &walker, (a % w, a / w), (b % w, b / w));
            let want = oracle(map, &nodes, climb.into(), a, b);
            match plan {
                Plan::Found(path) => {
                    prop_assert!((f64::from(path.cost) - want).abs() < 1e-4 * want.max(1.0), "{path:?} {want}");
                    prop_assert_eq!(path.points, points.len());
                    prop_assert_eq!(map.grid().cell_of(points[0]), Some((a % w, a / w)));
                    prop_assert_eq!(map.grid().cell_of(points[points.len() - 1]), Some((b % w, b / w)));
                    let length: f32 = points.windows(2).map(|p| p[0].distance(p[1])).sum();
                    prop_assert!((length - path.length).abs() < 1e-4);
                    // The grid's way in space is at most its horizontal length and its climb; at climb cost 1 or more the
                    // cost bounds both.
                    if climb >= 1.0 && policy != HolePolicy::Free {
                        prop_assert!(path.length <= path.cost + 1e-4, "{path:?}");
                    }
                    // Every point of the line lies in a walkable cell.
                    for p in points.windows(2) {
                        for i in 0..=300 {
                            let (x, y) = map.grid().cell_of(p[0].lerp(p[1], i as f32 / 300.0)).unwrap();
                            prop_assert!(nodes[y * w + x].walkable());
                        }
                    }
                    prop_assert!(keeps_clear(map, &points, &nodes, radius));
                }
                Plan::NoPath { .. } => prop_assert!(want.is_infinite()),
                _ => {
                    let bad = |i: usize| !nodes[i].walkable();
                    prop_assert!(bad(a) || bad(b), "{plan:?}");
                }
            }
            Ok(())
        })?;
    }
}

#[test]
fn a_wall_with_a_door_is_walked_around() {
    let floor = "..........";
    let wall = [floor, floor, floor, "#######..#", floor, floor, floor];
    let Plan::Found(path) = plan_art(&wall, &THIN, (1, 0), (1, 6)) else { panic!() };
    assert!(path.length > 1.3 && path.points >= 3, "{path:?}");
    // Too wide for the door: 0.2 m between the posts.
    let wide = Walker { radius: 0.17, ..Walker::DEFAULT };
    assert!(matches!(plan_art(&wall, &wide, (1, 0), (1, 6)), Plan::NoPath { .. }));
    let shut = ["..........", "##########", ".........."];
    assert!(matches!(plan_art(&shut, &THIN, (1, 0), (1, 2)), Plan::NoPath { .. }));
    // Diagonal neighbours do not let a walker slip between them.
    let diagonal = ["..#.", "..#.", ".#..", ".#.."];
    assert!(matches!(plan_art(&diagonal, &THIN, (0, 0), (3, 3)), Plan::NoPath { .. }));
}

#[test]
fn steps_and_slopes() {
    let up = |art: &str| plan_art(&[art; 5], &THIN, (0, 2), (art.len() - 1, 2));
    assert!(matches!(up("0000022222"), Plan::Found(_)), "a step of 0.2");
    assert!(matches!(up("0000033333"), Plan::NoPath { .. }), "a step of 0.3");
    // Stairs of 0.1 each 0.2 m: 27 degrees.
    assert!(matches!(up("0011223344556677"), Plan::Found(_)), "stairs");
    // 45 degrees, every single step low enough.
    assert!(matches!(up("0001234567899999"), Plan::NoPath { .. }), "a slope of 45 degrees");
    let steep = Walker { max_slope: 0.9, ..THIN };
    assert!(matches!(plan_art(&["0001234567899999"; 5], &steep, (0, 2), (15, 2)), Plan::Found(_)));
    // A hill that can be climbed is walked around when that is cheaper.
    let hill = ["..........", "..........", "...1221...", "...1221...", ".........."];
    let lazy = Walker { climb_cost: 5.0, ..THIN };
    let (Plan::Found(over), Plan::Found(around)) =
        (plan_art(&hill, &Walker { climb_cost: 0.0, ..THIN }, (0, 2), (9, 2)), plan_art(&hill, &lazy, (0, 2), (9, 2)))
    else {
        panic!()
    };
    assert!(
        (over.length - 0.9).abs() < 1e-4 && around.length > over.length && around.cost < 1.5,
        "{over:?} {around:?}"
    );
}

#[test]
fn every_other_answer() {
    let map = [".?#......."; 5];
    let ask = |w: &Walker, a, b| plan_art(&map, w, a, b);
    assert_eq!(ask(&THIN, (1, 0), (9, 0)), Plan::StartUnknown);
    assert_eq!(ask(&THIN, (9, 0), (1, 0)), Plan::GoalUnknown);
    assert_eq!(ask(&THIN, (2, 0), (9, 0)), Plan::StartBlocked);
    assert_eq!(ask(&THIN, (9, 0), (2, 0)), Plan::GoalBlocked);
    assert_eq!(ask(&Walker { radius: 0.1, ..THIN }, (9, 0), (3, 0)), Plan::GoalBlocked);
    assert_eq!(ask(&Walker { unknown: HolePolicy::Solid, ..THIN }, (9, 0), (1, 0)), Plan::GoalBlocked);
    assert!(matches!(ask(&THIN, (9, 0), (0, 0)), Plan::NoPath { .. }));
    let free = Walker { unknown: HolePolicy::Free, ..THIN };
    assert!(matches!(plan_art(&["..??..."], &free, (0, 0), (6, 0)), Plan::Found(_)));
    assert!(matches!(plan_art(&["..??..."], &THIN, (0, 0), (6, 0)), Plan::NoPath { .. }));
    with_map(4, 4, &[Some(0.0); 16], 0.1, |map| {
        let (far, mid) = (Vec3::X * 100.0, Vec3::splat(0.01));
        let mut nodes = [Node::EMPTY; 16];
        let mut p = [Vec3::ZERO; 1];
        let mut planner = Planner::new(&mut nodes);
        assert_eq!(planner.plan(map, &THIN, far, mid, &mut p), Ok(Plan::StartOutside));
        assert_eq!(planner.plan(map, &THIN, mid, Vec3::NAN, &mut p), Ok(Plan::GoalOutside));
        let corner = map.grid().point_of(0, 0, 0.0);
        assert_eq!(planner.plan(map, &THIN, mid, corner, &mut p), Ok(Plan::PointsExceeded { needed: 2, got: 1 }));
        assert!(matches!(planner.plan(map, &THIN, mid, mid, &mut p), Ok(Plan::Found(Path { points: 1, .. }))));
        let none = Planner::new(&mut []).plan(map, &THIN, mid, corner, &mut p);
        assert_eq!(none, Ok(Plan::NodesExceeded { needed: 16, got: 0 }));
        for bad in [
            Walker { radius: f32::NAN, ..THIN },
            Walker { max_step: 0.0, ..THIN },
            Walker { max_slope: 1.6, ..THIN },
            Walker { climb_cost: -1.0, ..THIN },
        ] {
            assert!(planner.plan(map, &bad, mid, mid, &mut p).is_err());
        }
        // A radius beyond the map must not take for ever.
        let vast = Walker { radius: 1e30, ..THIN };
        assert!(planner.plan(map, &vast, mid, corner, &mut p).is_ok());
    });
    with_map(0, 0, &[], 0.1, |map| {
        let plan = Planner::new(&mut []).plan(map, &THIN, Vec3::ZERO, Vec3::ZERO, &mut []);
        assert_eq!(plan, Ok(Plan::StartOutside));
    });
}

#[test]
fn replanned_only_when_it_matters() {
    let walker = Walker { radius: 0.1, ..Walker::DEFAULT };
    with_map(40, 40, &[Some(0.0); 1600], 0.1, |map| {
        let (a, b) = (map.grid().point_of(2, 5, 0.0), map.grid().point_of(37, 5, 0.0));
        let mut nodes = vec![Node::EMPTY; 1600];
        let mut points = [Vec3::ZERO; 32];
        let mut planner = Planner::new(&mut nodes);
        let Plan::Found(path) = planner.plan(map, &walker, a, b, &mut points).unwrap() else { panic!() };
        map.set(20, 30, 1.0, 1.0);
        assert_eq!(planner.replan(map, &walker, a, b, &path, &mut points), Ok(Replan::Kept));
        map.set(20, 5, 1.0, 1.0);
        let Ok(Replan::Planned(Plan::Found(around))) = planner.replan(map, &walker, a, b, &path, &mut points) else {
            panic!()
        };
        assert!(around.length > path.length + 0.005 && around.points >= 3, "{around:?}");
    });
}

/// Where every single change near a path would alter the terrain under it, replanning must notice.
#[test]
fn what_blocks_a_path_is_always_noticed() {
    let walker = Walker { radius: 0.25, ..Walker::DEFAULT };
    for i in 0..400 {
        with_map(20, 20, &[Some(0.0); 400], 0.1, |map| {
            let (Plan::Found(path), points, before) = plan_on(map, &walker, (4, 10), (16, 12)) else { panic!() };
            map.set(i % 20, i / 20, 0.5, 0.5);
            let (_, _, after) = plan_on(map, &walker, (4, 10), (16, 12));
            let blocked = points.windows(2).any(|p| {
                (0..=100).any(|t| {
                    let (x, y) = map.grid().cell_of(p[0].lerp(p[1], t as f32 / 100.0)).unwrap();
                    before[y * 20 + x].walkable() && !after[y * 20 + x].walkable()
                })
            });
            assert!(!blocked || path_changed(map, &walker, &points, path.generation), "cell {i}");
        });
    }
}

#[test]
fn a_map_without_cells_is_left_at_once() {
    let grid = Grid::new(Vec3::ZERO, Vec3::Y, Vec3::Z, 0.1, 0, 0).unwrap();
    let map = HeightMap::new(grid, &mut [], HeightMapParams::DEFAULT).unwrap();
    assert!(path_changed(&map, &Walker::DEFAULT, &[Vec3::ZERO, Vec3::X], 0));
    let plan = Planner::new(&mut []).plan(&map, &Walker::DEFAULT, Vec3::ZERO, Vec3::X, &mut []);
    assert_eq!(plan, Ok(Plan::StartOutside));
}

/// What classification must give, cell by cell, without leaving anything out: obstacles, and what is too near to one.
fn terrain_of(map: &HeightMap<'_>, walker: &Walker) -> (Vec<bool>, Vec<bool>) {
    let ((w, d), cell) = (map.grid().size(), map.grid().cell());
    let limit = |distance: f32| (distance * walker.max_slope.tan()).max(walker.max_step) + 1e-4;
    let spread = limit(cell * core::f32::consts::SQRT_2);
    let steep = |c: &HeightCell| c.is_known() && c.max - c.min > spread;
    let solid = walker.unknown == HolePolicy::Solid;
    let cells = map.cells();
    let mut obstacle: Vec<bool> = cells.iter().map(|c| steep(c) || (solid && !c.is_known())).collect();
    let height = |x: i32, y: i32| {
        let inside = x >= 0 && y >= 0 && x < w as i32 && y < d as i32;
        let c = &cells[if inside { y as usize * w + x as usize } else { return None }];
        (c.is_known() && !steep(c)).then_some(c.mean)
    };
    for (x, y) in (0..d as i32).flat_map(|y| (0..w as i32).map(move |x| (x, y))) {
        let Some(first) = height(x, y) else { continue };
        for (dx, dy) in [(1, 0), (0, 1), (1, 1), (-1, 1)] {
            let pace = if dx != 0 && dy != 0 { cell * core::f32::consts::SQRT_2 } else { cell };
            let at = |k: i32| (y + k * dy) as usize * w + (x + k * dx) as usize;
            let mut here = first;
            for k in 1..=terrain::window(walker, pace) as i32 {
                let Some(there) = height(x + k * dx, y + k * dy) else { break };
                if (there - here).abs() > limit(pace) {
                    if k == 1 {
                        obstacle[if there > here { at(1) } else { at(0) }] = true;
                    }
                    break;
                }
                if (there - first).abs() > limit(pace * k as f32) {
                    (1..k).for_each(|k| obstacle[at(k)] = true);
                    break;
                }
                here = there;
            }
        }
    }
    let radius = walker.radius / cell + 0.5;
    let near = |i: usize| {
        (0..w * d).any(|j| {
            let (dx, dy) = ((i % w).abs_diff(j % w) as f32, (i / w).abs_diff(j / w) as f32);
            obstacle[j] && dx * dx + dy * dy <= radius * radius
        })
    };
    let close = (0..w * d).map(near).collect();
    (obstacle, close)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    /// Steps noticed, slopes judged around them only, obstacles grown run by run: the same terrain as judging every cell.
    #[test]
    fn terrain_is_what_judging_every_cell_gives(
        w in 1_usize..40, d in 1_usize..40, seed in 1_u32.., cell in 0.01_f32..0.2, radius in 0.0_f32..0.4,
        max_step in 0.02_f32..0.4, max_slope in 0.1_f32..1.4, slant in proptest::array::uniform2(-1.0_f32..1.0),
        rough in 0.0_f32..0.3, holes in 0_u32..30, policy in 0_usize..3,
    ) {
        let mut s = seed;
        let mut next = || { s ^= s << 13; s ^= s >> 17; s ^= s << 5; s };
        // A slope that bends and steps, rough to a degree, with holes and things on it.
        let heights: Vec<Option<f32>> = (0..w * d).map(|i| {
            let (x, y) = ((i % w) as f32 * cell, (i / w) as f32 * cell);
            let noise = (next() % 1000) as f32 * 1e-3 * rough * max_step;
            let thing = if next() % 40 == 0 { 0.6 * max_step } else { 0.0 };
            let stairs = if x > 1.0 { (y * 4.0).floor() * 0.25 * max_step } else { 0.0 };
            (next() % 100 >= holes).then_some(slant[0] * x * x + slant[1] * y + noise + thing + stairs)
        }).collect();
        let unknown = [HolePolicy::Unknown, HolePolicy::Solid, HolePolicy::Free][policy];
        let walker = Walker { radius, max_step, max_slope, unknown, ..Walker::DEFAULT };
        with_map(w, d, &heights, cell, |map| {
            let mut nodes = vec![Node::EMPTY; w * d];
            terrain::classify(&mut nodes, map, &walker);
            let (obstacle, close) = terrain_of(map, &walker);
            for (i, node) in nodes.iter().enumerate() {
                prop_assert_eq!(node.is(Node::OBSTACLE), obstacle[i], "obstacle at {} {}", i % w, i / w);
                let unseen = unknown == HolePolicy::Unknown && !map.cells()[i].is_known();
                prop_assert_eq!(node.is(Node::UNKNOWN), unseen);
                prop_assert_eq!(node.walkable(), !(obstacle[i] || unseen || (close[i] && radius / cell + 0.5 >= 1.0)));
                prop_assert_eq!(node.key, [Node::OUT, f32::INFINITY][usize::from(node.walkable())]);
            }
            Ok(())
        })?;
    }
}
