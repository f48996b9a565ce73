//! Where a further board position would tell most: depths and parts of the picture where few boards have been.

use crate::calibrate::placed_sweep::PlacedSweep;

/// A board position that a sweep lacks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted {
    /// Depth of the board's middle, mm.
    pub depth_mm: f64,
    /// Where its middle should be seen, as parts of the picture's width and height; `None` along an axis on which a
    /// board fills most of the picture.
    pub place: [Option<f64>; 2],
}

/// A ray of the camera that some board has met.
pub struct Ray {
    /// Where in the picture, as parts of its width and height.
    pub place: [f64; 2],
    /// Depths at which boards have met it, mm.
    pub depths: Vec<f64>,
}

/// Positions that are named, at most.
const AT_MOST: usize = 3;
/// Depths that are tried, evenly over what the sweep spans.
const LEVELS: usize = 5;
/// Places that are tried along each axis of the picture.
const PLACES: usize = 3;
/// Rays along each axis of the picture.
pub const ACROSS: usize = 48;
/// Part of the picture that a board has to fill along an axis for its place on it not to matter.
const FILLS: f64 = 0.8;

/// Returns the positions that a sweep lacks most, the most wanted first: each halves as many rays' distances to the
/// next board, and adds to as many rays with few boards, as it can.
pub(super) fn wanted(placed: &PlacedSweep<'_>) -> Vec<Wanted> {
    let (width, height) = (placed.camera.width, placed.camera.height);
    let at = |i: usize, n: usize| (2 * i + 1) * n / (2 * ACROSS);
    let pixels = (0..ACROSS * ACROSS).map(|i| (at(i % ACROSS, width), at(i / ACROSS, height)));
    let rays = pixels.map(|(x, y)| {
        let dir = &placed.dirs[y * width + x];
        let depths = placed.boards.iter().filter_map(|b| b.hit(dir)).map(|t| t * dir.z).collect();
        Ray { place: [(x as f64 + 0.5) / width as f64, (y as f64 + 0.5) / height as f64], depths }
    });
    choose(rays.filter(|r| !r.depths.is_empty()).collect(), placed.boards.len())
}

/// Chooses among boards that fill as much of the picture as those of the sweep do, at all depths and places.
pub fn choose(mut rays: Vec<Ray>, n_boards: usize) -> Vec<Wanted> {
    let depths = || rays.iter().flat_map(|r| &r.depths).copied();
    let (near, far) = depths().fold((f64::INFINITY, 0.0f64), |(lo, hi), z| (lo.min(z), hi.max(z)));
    if near >= far {
        return Vec::new();
    }
    // Half the side of a square that has the area of a board's picture.
    let area = depths().count() as f64 / (n_boards * ACROSS * ACROSS) as f64;
    let half = 0.5 * area.sqrt();
    let spacing = (far - near) / LEVELS as f64;
    let places: Vec<f64> = match 2.0 * half >= FILLS {
        true => vec![0.5],
        false => (0..PLACES).map(|i| (i as f64 + 0.5) / PLACES as f64).collect(),
    };
    let mut all = Vec::new();
    while all.len() < AT_MOST {
        let mut best: Option<(f64, [f64; 2], f64)> = None;
        for level in 0..LEVELS {
            let z = near + (level as f64 + 0.5) * spacing;
            for place in places.iter().flat_map(|y| places.iter().map(move |x| [*x, *y])) {
                let gain = rays.iter().filter(|r| covers(place, half, r)).map(|r| gain(r, z)).sum::<f64>();
                if gain > best.map_or(0.0, |b| b.0) {
                    best = Some((gain, place, z));
                }
            }
        }
        let Some((_, place, depth_mm)) = best else { break };
        let known = |at: f64| (places.len() > 1).then_some(at);
        all.push(Wanted { depth_mm, place: place.map(known) });
        rays.iter_mut().filter(|r| covers(place, half, r)).for_each(|r| r.depths.push(depth_mm));
    }
    all
}

/// Whether a board whose picture is centered at `place` meets a ray.
fn covers(place: [f64; 2], half: f64, ray: &Ray) -> bool {
    (0..2).all(|a| (ray.place[a] - place[a]).abs() <= half)
}

/// What a board at depth `z` tells of a ray: the variance of a mean of n falls by 1/n − 1/(n + 1), and the nearer
/// another board is, the more it has told already.
fn gain(ray: &Ray, z: f64) -> f64 {
    let n = ray.depths.len() as f64;
    let next = ray.depths.iter().map(|d| (d - z).abs()).fold(f64::INFINITY, f64::min);
    (1.0 / n - 1.0 / (n + 1.0)) * next
}

/// Returns the wanted positions as words, such as "at about 740 mm in the upper left of the picture".
pub fn named(wanted: &[Wanted]) -> String {
    let one = |w: &Wanted| {
        let third = |at: Option<f64>, names: [&'static str; 3]| at.map(|at| names[((3.0 * at) as usize).min(2)]);
        let down = third(w.place[1], ["upper", "", "lower"]);
        let across = third(w.place[0], ["left", "", "right"]);
        let place = match (down, across) {
            (None, _) | (_, None) => String::new(),
            (Some(""), Some("")) => " in the middle of the picture".into(),
            (Some(""), Some(a)) => format!(" on the {a} of the picture"),
            (Some(d), Some("")) => format!(" in the {d} part of the picture"),
            (Some(d), Some(a)) => format!(" in the {d} {a} of the picture"),
        };
        format!("at about {:.0} mm{place}", w.depth_mm)
    };
    wanted.iter().map(one).collect::<Vec<_>>().join(", ")
}
