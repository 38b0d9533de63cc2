//! Ways across the floor: against Dijkstra's on the same cells, and against the shortest line of all.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::hint::black_box;

use isobath::glam::Vec3;
use isobath::localized::height_map::{Grid, HeightCell, HeightMap, HeightMapParams};
use isobath::localized::planner::{Node, Plan, Planner, Walker};

use crate::input::{Input, Random, Sensor, mean, on_frame, vec3};
use crate::row::{Measure, Method, Row, Score};

/// A* and the pulled string.
pub(crate) const PATH: Row = Row {
    name: "path",
    title: "Way across the floor seen, 5 cm cells",
    unit: "path",
    errors: &[
        Measure {
            unit: "mm",
            name: "longer",
            what: "mean length above that of Dijkstra on 16 directions over the same cells; less than 0: the pulled string is shorter",
            shown: true,
        },
        Measure {
            unit: "mm",
            name: "grid",
            what: "largest difference of the cost before pulling from Dijkstra's on 8 directions",
            shown: true,
        },
    ],
    sensors: &[Sensor::Exact, Sensor::Kinect],
    scenes: &["sphere", "corner", "stairs", "living-room", "corridor"],
    methods,
    answers: None,
};

const CELL: f32 = 0.05;
const SIDE: usize = 96;
const PATHS: usize = 12;
/// Climbing costs nothing here, so that cost is length.
const WALKER: Walker = Walker { radius: 0.1, climb_cost: 0.0, ..Walker::DEFAULT };

struct Query {
    from: Vec3,
    to: Vec3,
    /// Metres over 8 and over 16 directions.
    eight: f64,
    sixteen: f64,
}

fn methods(input: &Input) -> Vec<Method<'_>> {
    let forward = input.pose.direction_to_world(Vec3::Z);
    let eye = vec3(input.place.translation);
    let centre = eye + (forward - Vec3::Y * forward.y).normalize_or_zero() * 2.2;
    let Ok(grid) = Grid::new(centre, Vec3::Y, forward, CELL, SIDE, SIDE) else { return Vec::new() };
    let map_of = |cells| HeightMap::new(grid, cells, HeightMapParams::DEFAULT).ok();
    // Leaked: a map borrows its cells, and both live as long as the program measures.
    let cells: &'static mut [HeightCell] = vec![HeightCell::UNKNOWN; SIDE * SIDE].leak();
    let Some(mut map) = map_of(cells) else { return Vec::new() };
    on_frame!(input, frame => _ = map.integrate(&frame));
    let map: &'static HeightMap<'static> = Box::leak(Box::new(map));
    let queries = queries(map, input.seed);
    if queries.is_empty() {
        return Vec::new();
    }
    let n = queries.len();
    let ends: Vec<_> = queries.iter().map(|q| (q.from, q.to)).collect();
    let mut nodes = vec![Node::EMPTY; SIDE * SIDE];
    let mut again = nodes.clone();
    let mut points = [Vec3::ZERO; 256];
    let run = move || {
        for &(from, to) in &ends {
            let _ = black_box(Planner::new(&mut nodes).plan(map, &WALKER, from, to, &mut points));
        }
    };
    let score = move || {
        let (mut longer, mut grid) = (Vec::new(), 0.0_f64);
        for q in &queries {
            let plan = Planner::new(&mut again).plan(map, &WALKER, q.from, q.to, &mut points);
            if let Ok(Plan::Found(path)) = plan {
                let level = points[..path.points].windows(2).map(|p| flat(p[1] - p[0])).sum::<f64>();
                longer.push(1e3 * (level - q.sixteen));
                grid = grid.max(1e3 * (f64::from(path.cost) - q.eight).abs());
            }
        }
        Score::of([mean(&longer), grid])
    };
    vec![Method::new("A*, string pulled", n, run, score)]
}

fn flat(v: Vec3) -> f64 {
    f64::from(v.x).hypot(f64::from(v.z))
}

/// Ends by chance, at least a metre apart, with a way between them.
fn queries(map: &HeightMap<'_>, seed: u64) -> Vec<Query> {
    let grid = *map.grid();
    let mut nodes = vec![Node::EMPTY; SIDE * SIDE];
    let mut points = [Vec3::ZERO; 256];
    let mut random = Random::new(seed ^ 0xa57a);
    // A first plan, wherever it leads, tells which cells can be walked on.
    let middle = grid.point_of(SIDE / 2, SIDE / 2, 0.0);
    let _ = Planner::new(&mut nodes).plan(map, &WALKER, middle, middle, &mut points);
    let walkable: Vec<bool> = nodes.iter().map(Node::is_walkable).collect();
    let places: Vec<usize> = (0..walkable.len()).filter(|&i| walkable[i]).collect();
    let mut out = Vec::new();
    for _ in 0..20 * PATHS {
        let [Some(&a), Some(&b)] = [0, 1].map(|_| places.get(random.below(places.len()))) else { break };
        let [from, to] = [a, b].map(|i| grid.point_of(i % SIDE, i / SIDE, 0.0));
        if flat(to - from) < 1.0 {
            continue;
        }
        let (Some(eight), Some(sixteen)) = (dijkstra(&walkable, a, b, &STEPS[..8]), dijkstra(&walkable, a, b, &STEPS))
        else {
            continue;
        };
        out.push(Query { from, to, eight, sixteen });
        if out.len() == PATHS {
            break;
        }
    }
    out
}

/// Eight neighbours, then the knight's moves.
const STEPS: [(i32, i32); 16] = [
    (1, 0),
    (-1, 0),
    (0, 1),
    (0, -1),
    (1, 1),
    (1, -1),
    (-1, 1),
    (-1, -1),
    (2, 1),
    (2, -1),
    (-2, 1),
    (-2, -1),
    (1, 2),
    (1, -2),
    (-1, 2),
    (-1, -2),
];

/// Metres of the shortest way over walkable cells; every cell that a step touches must be walkable.
fn dijkstra(walkable: &[bool], from: usize, to: usize, steps: &[(i32, i32)]) -> Option<f64> {
    let side = SIDE as i32;
    let free = |x: i32, y: i32| {
        (0..side).contains(&x) && (0..side).contains(&y) && walkable.get((y * side + x) as usize) == Some(&true)
    };
    let mut best = vec![f64::INFINITY; walkable.len()];
    let mut queue = BinaryHeap::from([(Reverse(0_u64), from)]);
    best[from] = 0.0;
    while let Some((Reverse(bits), i)) = queue.pop() {
        // Bits of non-negative floats are in the order of their values.
        let cost = f64::from_bits(bits);
        if i == to {
            return Some(cost * f64::from(CELL));
        }
        if cost > best[i] {
            continue;
        }
        let (x, y) = (i as i32 % side, i as i32 / side);
        for &(dx, dy) in steps {
            // The corners of the step's box: for straight steps itself, for diagonals both sides; a knight's passes two more.
            let (nx, ny) = (x + dx, y + dy);
            let sides = match (dx.abs(), dy.abs()) {
                (1, 1) => free(x + dx, y) && free(x, y + dy),
                (2, 1) => free(x + dx / 2, y) && free(x + dx / 2, y + dy),
                (1, 2) => free(x, y + dy / 2) && free(x + dx, y + dy / 2),
                _ => true,
            };
            if !free(nx, ny) || !sides {
                continue;
            }
            let (n, total) = ((ny * side + nx) as usize, cost + f64::from(dx * dx + dy * dy).sqrt());
            if total < best[n] {
                best[n] = total;
                queue.push((Reverse(total.to_bits()), n));
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dijkstra_walks_around() {
        let mut walkable = vec![true; SIDE * SIDE];
        let at = |x: usize, y: usize| y * SIDE + x;
        let metres = |cells: f64| cells * f64::from(CELL);
        let far = dijkstra(&walkable, at(0, 0), at(10, 5), &STEPS).unwrap();
        assert!((far - metres(125.0_f64.sqrt())).abs() < 1e-9, "knight's moves reach it straight");
        let octile = dijkstra(&walkable, at(0, 0), at(10, 5), &STEPS[..8]).unwrap();
        assert!((octile - metres(5.0 + 5.0 * 2.0_f64.sqrt())).abs() < 1e-9);
        (0..SIDE).for_each(|y| walkable[at(5, y)] = false);
        assert_eq!(dijkstra(&walkable, at(0, 0), at(10, 5), &STEPS), None);
    }
}
