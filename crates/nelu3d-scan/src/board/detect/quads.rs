//! Dark quadrilaterals: local threshold, connected regions, and the quadrilateral that fills a region's hull.

use super::gray::Decimated;

/// Sides of a quadrilateral are at least this long, px.
const MIN_SIDE: f64 = 8.0;

/// Finds all dark quadrilaterals, clockwise as seen in the image. The same one may be found several times.
pub(super) fn find(image: &Decimated) -> Vec<[[f64; 2]; 4]> {
    let small = image.width.min(image.height);
    let sums = Integral::new(image);
    let mut quads = Vec::new();
    // A window much larger than a marker sees its outside as bright; one much smaller still sees its border as a ring.
    for radius in [small / 60, small / 20, small / 6] {
        let dark = threshold(image, &sums, radius.max(4));
        regions(&dark, image.width, image.height, |pixels| quads.extend(quad(pixels)));
    }
    quads
}

struct Integral {
    sums: Vec<u64>,
    stride: usize,
}

impl Integral {
    fn new(image: &Decimated) -> Self {
        let stride = image.width + 1;
        let mut sums = vec![0u64; stride * (image.height + 1)];
        for y in 0..image.height {
            let mut row = 0u64;
            for x in 0..image.width {
                row += u64::from(image.data[y * image.width + x]);
                sums[(y + 1) * stride + x + 1] = sums[y * stride + x + 1] + row;
            }
        }
        Self { sums, stride }
    }
}

/// Returns the pixels clearly darker than the mean around them.
fn threshold(image: &Decimated, integral: &Integral, radius: usize) -> Vec<bool> {
    let (w, h, s) = (image.width, image.height, integral.stride);
    let mut dark = vec![false; w * h];
    for y in 0..h {
        let (y0, y1) = (y.saturating_sub(radius), (y + radius + 1).min(h));
        for x in 0..w {
            let (x0, x1) = (x.saturating_sub(radius), (x + radius + 1).min(w));
            let sums = &integral.sums;
            let sum = sums[y1 * s + x1] + sums[y0 * s + x0] - sums[y0 * s + x1] - sums[y1 * s + x0];
            let mean = sum as f64 / ((x1 - x0) * (y1 - y0)) as f64;
            dark[y * w + x] = f64::from(image.data[y * w + x]) < 0.92 * mean - 3.0;
        }
    }
    dark
}

/// Calls `visit` with the pixels of each connected region that does not touch the image's edge.
fn regions(dark: &[bool], width: usize, height: usize, mut visit: impl FnMut(&[[u32; 2]])) {
    let mut seen = vec![false; dark.len()];
    let mut pixels: Vec<[u32; 2]> = Vec::new();
    for start in 0..dark.len() {
        if !dark[start] || seen[start] {
            continue;
        }
        pixels.clear();
        seen[start] = true;
        pixels.push([(start % width) as u32, (start / width) as u32]);
        let mut next = 0;
        let mut at_edge = false;
        while next < pixels.len() {
            let [x, y] = pixels[next].map(|v| v as usize);
            next += 1;
            if x == 0 || y == 0 || x + 1 == width || y + 1 == height {
                at_edge = true;
                continue;
            }
            for i in [y * width + x - 1, y * width + x + 1, (y - 1) * width + x, (y + 1) * width + x] {
                if dark[i] && !seen[i] {
                    seen[i] = true;
                    pixels.push([(i % width) as u32, (i / width) as u32]);
                }
            }
        }
        if !at_edge && pixels.len() as f64 >= MIN_SIDE * MIN_SIDE / 3.0 {
            visit(&pixels);
        }
    }
}

/// Returns the quadrilateral that a region fills, if there is one.
fn quad(pixels: &[[u32; 2]]) -> Option<[[f64; 2]; 4]> {
    let hull = hull(pixels);
    if hull.len() < 4 {
        return None;
    }
    let area = |p: &[[f64; 2]]| -> f64 {
        let n = p.len();
        0.5 * (0..n).map(|i| p[i][0] * p[(i + 1) % n][1] - p[i][1] * p[(i + 1) % n][0]).sum::<f64>()
    };
    // Four hull points of largest area: start from the extremes of the two diagonals, move one at a time while it
    // grows.
    let extreme = |f: &dyn Fn(&[f64; 2]) -> f64| {
        (0..hull.len()).max_by(|&a, &b| f(&hull[a]).total_cmp(&f(&hull[b]))).expect("the hull is not empty")
    };
    let n = hull.len() as f64;
    let center = hull.iter().fold([0.0; 2], |c, p| [c[0] + p[0] / n, c[1] + p[1] / n]);
    let a = extreme(&|p| (p[0] - center[0]).hypot(p[1] - center[1]));
    let c = extreme(&|p| (p[0] - hull[a][0]).hypot(p[1] - hull[a][1]));
    let d = [hull[c][0] - hull[a][0], hull[c][1] - hull[a][1]];
    let side = |p: &[f64; 2]| d[0] * (p[1] - hull[a][1]) - d[1] * (p[0] - hull[a][0]);
    let mut pick = [a, extreme(&side), c, extreme(&|p| -side(p))];
    pick.sort_unstable();
    for _ in 0..20 {
        let before = pick;
        for k in 0..4 {
            let (lo, hi) = (pick[(k + 3) % 4], pick[(k + 1) % 4]);
            let fits = |i: usize| if lo < hi { lo < i && i < hi } else { i > lo || i < hi };
            let with = |i: usize| {
                let mut p = pick;
                p[k] = i;
                area(&p.map(|i| hull[i]))
            };
            if let Some(i) = (0..hull.len()).filter(|&i| fits(i)).max_by(|&i, &j| with(i).total_cmp(&with(j)))
                && with(i) > with(pick[k])
            {
                pick[k] = i;
            }
        }
        if pick == before {
            break;
        }
    }
    let quad = pick.map(|i| hull[i]);
    let sides = (0..4).map(|i| (quad[i][0] - quad[(i + 1) % 4][0]).hypot(quad[i][1] - quad[(i + 1) % 4][1]));
    let (inside, whole) = (area(&quad), area(&hull));
    let fills = inside > 0.85 * whole && pixels.len() as f64 > 0.25 * whole;
    (fills && sides.fold(f64::INFINITY, f64::min) >= MIN_SIDE).then_some(quad)
}

/// Returns the convex hull of a region (of its pixels' corners), clockwise as seen in the image: Andrew's monotone
/// chain.
fn hull(pixels: &[[u32; 2]]) -> Vec<[f64; 2]> {
    let (top, bottom) = pixels.iter().fold((u32::MAX, 0), |(a, b), p| (a.min(p[1]), b.max(p[1])));
    let mut rows = vec![(u32::MAX, 0u32); (bottom - top + 1) as usize];
    for p in pixels {
        let row = &mut rows[(p[1] - top) as usize];
        *row = (row.0.min(p[0]), row.1.max(p[0]));
    }
    // Sorted by y, then x.
    let mut points = Vec::with_capacity(4 * rows.len());
    for (i, &(x0, x1)) in rows.iter().enumerate() {
        let y = f64::from(top) + i as f64;
        let (x0, x1) = (f64::from(x0) - 0.5, f64::from(x1) + 0.5);
        points.extend([[x0, y - 0.5], [x1, y - 0.5], [x0, y + 0.5], [x1, y + 0.5]]);
    }
    points.sort_by(|a, b| a[1].total_cmp(&b[1]).then(a[0].total_cmp(&b[0])));
    let cross = |o: [f64; 2], a: [f64; 2], b: [f64; 2]| (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
    let chain = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut out: Vec<[f64; 2]> = Vec::new();
        for p in points {
            while out.len() >= 2 && cross(out[out.len() - 2], out[out.len() - 1], p) <= 0.0 {
                out.pop();
            }
            out.push(p);
        }
        out.pop();
        out
    };
    let mut hull = chain(&mut points.iter().copied());
    hull.extend(chain(&mut points.iter().rev().copied()));
    hull
}
