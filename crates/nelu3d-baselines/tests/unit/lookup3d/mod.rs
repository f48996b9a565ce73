//! A scanner in closed form: fringes that a pixel sees as sines of its inverse depth, boards on planes of constant z.

mod interpolate;

use nelu3d::sensor::Measurements;
use nelu3d::surface::PixelStatus;
use nelu3d_baselines::lookup3d::file::{Expected, info, read, write_npy, write_npz};
use nelu3d_baselines::lookup3d::{
    FullTable, Interpolation, LookupMaps, MapBuffers, Rank, Search, SearchSettings, Table, TableShape, compress,
    decode as decode_in, decode_near as decode_near_in,
};
use nelu3d_scan::Camera;

const WIDTH: usize = 40;
const HEIGHT: usize = 30;
const K: usize = 3;
const NEAR: f32 = 500.0;
const FAR: f32 = 600.0;

/// Shifted sines, less than one period over the whole range: every codeword is at one depth only.
fn code(pixel: usize, depth: f32) -> [f32; K] {
    let v = (1.0 / depth - 1.0 / FAR) / (1.0 / NEAR - 1.0 / FAR);
    let phase = 5.0 * v + 0.3 * (pixel % WIDTH) as f32 + 0.02 * (pixel / WIDTH) as f32;
    std::array::from_fn(|j| 0.5 + 0.4 * (phase + j as f32 * std::f32::consts::TAU / 3.0).sin())
}

fn board(p: usize, n_positions: usize) -> f32 {
    NEAR + (FAR - NEAR) * p as f32 / (n_positions - 1) as f32
}

fn table(step: usize, n_positions: usize, missing: impl Fn(usize, usize) -> bool) -> FullTable {
    let shape = TableShape::of_picture(WIDTH, HEIGHT, step, n_positions, K);
    let mut table = FullTable::empty(shape);
    for i in 0..shape.n_pixels() {
        let pixel = i / shape.width * step * WIDTH + i % shape.width * step;
        for p in 0..n_positions {
            let mut sample = [f32::NAN; K + 1];
            let depth = board(p, n_positions);
            sample[K] = depth;
            if !missing(i, p) {
                sample[..K].copy_from_slice(&code(pixel, depth));
            }
            table.set(i, p, &sample);
        }
    }
    table
}

/// A slope with a step in the middle.
fn surface(pixel: usize) -> f32 {
    let (x, y) = ((pixel % WIDTH) as f32, (pixel / WIDTH) as f32);
    520.0 + 0.3 * x + 0.8 * y + if x > 18.0 { 25.0 } else { 0.0 }
}

fn seen(p: Vec<f32>) -> Measurements {
    let n = WIDTH * HEIGHT;
    Measurements {
        width: WIDTH,
        height: HEIGHT,
        image: [WIDTH, HEIGHT],
        k: K,
        independent: K as f32,
        p,
        inv_var: vec![1e6; n * K],
        surround: vec![0.5; n * K],
        status: vec![PixelStatus::Valid; n],
        contrast: vec![1.0; n],
        light: vec![1.0; n],
        has_black: true,
    }
}

fn scene(depth: impl Fn(usize) -> f32) -> Measurements {
    seen((0..WIDTH * HEIGHT).flat_map(|i| code(i, depth(i))).collect())
}

fn camera() -> Camera {
    Camera::pinhole(WIDTH, HEIGHT, 1000.0, 1000.0, 19.5, 14.5)
}

/// Settings that reject what noise does not explain.
fn strict() -> SearchSettings {
    SearchSettings { max_residual: 6.0, ..SearchSettings::default() }
}

fn with(interpolation: Interpolation) -> SearchSettings {
    SearchSettings { interpolation, ..strict() }
}

fn worst(depth: &[f32], truth: impl Fn(usize) -> f32) -> f32 {
    depth
        .iter()
        .enumerate()
        .map(|(i, z)| (z - truth(i)).abs())
        .fold(0.0, |a, b| if b > a || b.is_nan() { b } else { a })
}

fn decode(table: &Table, m: &Measurements, camera: &Camera, settings: &SearchSettings) -> LookupMaps {
    decode_in(table, m, camera, settings, MapBuffers::default())
}

fn decode_near(
    table: &Table,
    m: &Measurements,
    camera: &Camera,
    settings: &SearchSettings,
    previous: &[f32],
) -> LookupMaps {
    decode_near_in(table, m, camera, settings, MapBuffers::default(), previous)
}

#[test]
fn without_noise_the_error_is_that_of_interpolation_between_positions() {
    let table = Table::Full(table(1, 21, |_, _| false));
    let m = scene(surface);
    let error = |i| worst(&decode(&table, &m, &camera(), &with(i)).depth, surface);
    // Boards 5 mm apart. The nearest: half a step and what the code's own curve adds.
    let none = error(Interpolation::None);
    assert!((2.2..2.6).contains(&none), "{none}");
    // A chord of phase δ is off by δ²/8 of its radius at most, here 0.3²/8 of a radian; the cubic by δ⁴ · 3/128.
    let radian_mm = 1.25 * (FAR - NEAR) / 5.0;
    let (linear, cubic) = (error(Interpolation::Linear), error(Interpolation::Cubic));
    assert!(linear < 0.3f32.powi(2) / 8.0 * radian_mm, "{linear}");
    assert!(cubic < 0.3f32.powi(4) * 3.0 / 128.0 * radian_mm + 1e-3, "{cubic}");
    assert!(cubic < 0.2 * linear, "{cubic} {linear}");
    let parabola = error(Interpolation::Parabola);
    assert!(parabola < 0.2 * none, "{parabola}");
}

#[test]
fn the_stated_sigma_is_that_of_repeated_measurements() {
    let table = Table::Full(table(1, 21, |_, _| false));
    let noise = 0.02f32;
    let mut state = 5u64;
    let mut normal = || {
        let mut sum = 0.0;
        for _ in 0..12 {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            sum += (state >> 40) as f32 / (1u64 << 24) as f32;
        }
        sum - 6.0
    };
    let mut m = scene(|_| 548.0);
    m.p.iter_mut().for_each(|p| *p += noise * normal());
    m.inv_var.fill(1.0 / (noise * noise));
    let maps = decode(&table, &m, &camera(), &with(Interpolation::Cubic));
    let z: Vec<f32> =
        maps.depth.iter().zip(&maps.sigma).filter(|(z, _)| z.is_finite()).map(|(z, s)| (z - 548.0) / s).collect();
    let spread = (z.iter().map(|z| z * z).sum::<f32>() / z.len() as f32).sqrt();
    assert!(z.len() > 1150 && (0.93..1.07).contains(&spread), "{} {spread}", z.len());
}

#[test]
fn missing_samples_are_never_chosen() {
    // Rows of pixels lack positions at either end, in between, or all.
    let gone = |i: usize, p: usize| match i / WIDTH {
        0 => true,
        1 => p < 6,
        2 => p % 3 == 1,
        3 => p > 4,
        _ => false,
    };
    let full = table(1, 21, gone);
    let m = scene(|_| 540.0);
    for table in [Table::Full(full.clone()), Table::LowRank(compress(&full, Rank::Fixed(21)).table)] {
        let maps = decode(&table, &m, &camera(), &with(Interpolation::Cubic));
        for (i, p) in maps.index.iter().enumerate().filter(|(_, p)| **p != u32::MAX) {
            // A low-rank table has no holes inside of a range, they are filled.
            assert!(!gone(i, *p as usize) || matches!(table, Table::LowRank(_)) && i / WIDTH == 2);
        }
        let left = |row: usize| &maps.status[row * WIDTH..(row + 1) * WIDTH];
        assert!(left(0).iter().all(|l| *l == PixelStatus::OutsideVolume));
        assert!(left(1).iter().chain(left(2)).chain(left(5)).all(|l| *l == PixelStatus::Valid));
        // 540 mm lies beyond the last board that these pixels saw.
        assert!(left(3).iter().all(|l| *l == PixelStatus::Ambiguous));
        assert!(worst(&maps.depth[WIDTH..2 * WIDTH], |_| 540.0) < 0.05);
        assert!(worst(&maps.depth[2 * WIDTH..3 * WIDTH], |_| 540.0) < 1.0);
    }
}

#[test]
fn channels_that_were_not_measured_take_no_part_and_nonsense_is_left_out() {
    let table = Table::Full(table(1, 21, |_, _| false));
    let mut m = scene(|_| 533.0);
    for i in 0..WIDTH {
        m.p[i * K] = 7.0;
        m.inv_var[i * K] = 0.0;
        m.p[(i + WIDTH) * K..][..K].copy_from_slice(&[0.95, 0.95, 0.95]);
        m.status[i + 2 * WIDTH] = PixelStatus::Saturated;
    }
    let maps = decode(&table, &m, &camera(), &strict());
    // Two of three shifts leave two depths to a codeword at worst; most pixels know theirs.
    let close = maps.depth[..WIDTH].iter().filter(|z| (*z - 533.0).abs() < 0.5).count();
    assert!(close > WIDTH * 3 / 4, "{close}");
    assert!(maps.status[WIDTH..2 * WIDTH].iter().all(|l| *l == PixelStatus::Ambiguous));
    assert!(maps.status[2 * WIDTH..3 * WIDTH].iter().all(|l| *l == PixelStatus::Saturated));
    // By default nothing is rejected for its residual.
    let all = decode(&table, &m, &camera(), &SearchSettings::default());
    assert!(all.depth[WIDTH..2 * WIDTH].iter().all(|z| z.is_finite()));
    let similar = decode(&table, &m, &camera(), &SearchSettings { max_difference: 0.1, ..strict() });
    assert!(similar.status[WIDTH..2 * WIDTH].iter().all(|l| *l == PixelStatus::Ambiguous));
}

#[test]
fn whatever_memory_maps_are_made_in_they_are_the_same() {
    let table = Table::Full(table(1, 21, |i, _| i % 7 == 0));
    let mut m = scene(surface);
    m.status[5] = PixelStatus::Underexposed;
    let bits =
        |maps: &LookupMaps| [&maps.depth, &maps.sigma, &maps.residual].map(|m| m.iter().map(|v| v.to_bits()).collect());
    let fresh = decode(&table, &m, &camera(), &strict());
    let memory = MapBuffers::of(&mut m);
    assert!(m.surround.is_empty() && m.contrast.is_empty() && m.light.is_empty());
    let used = decode_in(&table, &m, &camera(), &strict(), memory);
    let (fresh, used): ([Vec<u32>; 3], [Vec<u32>; 3]) = (bits(&fresh), bits(&used));
    assert_eq!(fresh, used);
}

#[test]
fn coarse_to_fine_finds_what_brute_force_finds() {
    let table = Table::Full(table(1, 21, |_, _| false));
    let m = scene(surface);
    let brute = decode(&table, &m, &camera(), &strict());
    let fine = decode(&table, &m, &camera(), &SearchSettings { search: Search::CoarseToFine, ..strict() });
    assert_eq!(brute.index, fine.index);
    assert_eq!(brute.depth, fine.depth);
    assert_eq!(brute.n_fallbacks, 0);
    assert!(fine.n_fallbacks < WIDTH * HEIGHT / 10, "{}", fine.n_fallbacks);
}

#[test]
fn an_earlier_frame_narrows_the_search_and_a_wrong_one_does_no_harm() {
    let table = Table::Full(table(1, 21, |_, _| false));
    let moved = |i| surface(i) + 4.0;
    let m = scene(moved);
    let settings = SearchSettings { window: 3, ..strict() };
    let brute = decode(&table, &m, &camera(), &settings);
    let n = WIDTH * HEIGHT;
    let before: Vec<f32> = (0..n).map(|i| if i % 9 == 0 { f32::NAN } else { surface(i) }).collect();
    let near = decode_near(&table, &m, &camera(), &settings, &before);
    assert_eq!(near.depth, brute.depth);
    assert!(near.n_fallbacks < n / 20, "{}", near.n_fallbacks);
    let far = decode_near(&table, &m, &camera(), &settings, &vec![FAR; n]);
    assert_eq!(far.depth, brute.depth);
    assert!(far.n_fallbacks > n / 2);
}

#[test]
fn all_terms_are_the_table_and_few_are_close_to_it() {
    let full = table(1, 21, |i, p| i < 5 && p < i);
    let exact = compress(&full, Rank::Fixed(21)).table;
    assert_eq!((exact.rank, exact.depth_rank), (21, 21));
    let (whole, product) = (Table::Full(full.clone()), Table::LowRank(exact));
    let (mut a, mut b) = ([0.0; K + 1], [0.0; K + 1]);
    for i in 0..WIDTH * HEIGHT {
        for p in 0..21 {
            let there = whole.sample(i, p, &mut a);
            assert_eq!(there, product.sample(i, p, &mut b));
            if there {
                assert!((0..K).all(|j| (a[j] - b[j]).abs() < 1e-5) && (a[K] - b[K]).abs() < 1e-2, "{a:?} {b:?}");
            }
        }
    }
    let m = scene(surface);
    let maps = decode(&product, &m, &camera(), &strict());
    assert!(worst(&maps.depth, surface) < 0.02);

    // A sine of any phase is two terms, a constant one: three are the whole table; planes of constant z are one term.
    let mut full = table(1, 21, |_, _| false);
    full.variance = 1e-8;
    let few = compress(&full, Rank::Auto);
    assert_eq!((few.table.rank, few.table.depth_rank), (3, 1));
    assert!(few.rms.iter().all(|r| *r < 1e-3) && few.depth_rms_mm < 0.01, "{few:?}");
    let two = compress(&full, Rank::Fixed(2));
    assert!(two.table.rank == 2 && two.rms[0] > 10.0 * few.rms[0]);
    assert!(few.table.bytes() * 4 < whole.bytes());
    let maps = decode(&Table::LowRank(few.table), &m, &camera(), &strict());
    assert!(worst(&maps.depth, surface) < 0.1);
}

#[test]
fn noise_is_not_kept() {
    let mut full = table(1, 21, |_, _| false);
    let mut state = 11u64;
    for i in 0..WIDTH * HEIGHT {
        for p in 0..21 {
            let mut sample = [0.0; K + 1];
            sample[K] = board(p, 21);
            for (s, c) in sample.iter_mut().zip(code(i, board(p, 21))) {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                *s = c + 0.04 * ((state >> 40) as f32 / (1u64 << 24) as f32 - 0.5);
            }
            full.set(i, p, &sample);
        }
    }
    // Unknown, and told by the spectrum: 0.04 / √12.
    let blind = compress(&full, Rank::Auto);
    assert!((blind.noise - 0.0115).abs() < 0.002, "{}", blind.noise);
    assert!((3..6).contains(&blind.table.rank), "{}", blind.table.rank);
    full.variance = 0.04f32.powi(2) / 12.0;
    assert_eq!(compress(&full, Rank::Auto).table.rank, 3);
}

#[test]
fn a_table_of_every_other_pixel_decodes_all_but_edges() {
    let table = Table::Full(table(2, 21, |_, _| false));
    let maps = decode(&table, &scene(surface), &camera(), &strict());
    assert_eq!(maps.depth.len(), WIDTH * HEIGHT);
    assert_eq!(maps.index.len(), WIDTH * HEIGHT / 4);
    let inside = |i: &usize| i % WIDTH < WIDTH - 1 && i / WIDTH < HEIGHT - 1;
    for i in (0..WIDTH * HEIGHT).filter(inside) {
        if maps.status[i] == PixelStatus::Valid {
            assert!((maps.depth[i] - surface(i)).abs() < 0.1, "{i}: {} {}", maps.depth[i], surface(i));
        } else {
            assert!(maps.status[i] == PixelStatus::DepthDiscontinuity && (18..20).contains(&(i % WIDTH)), "{i}");
        }
    }
}

#[test]
fn tables_are_read_back_as_they_were_written() {
    let dir = tempfile::tempdir().unwrap();
    let full = table(2, 7, |i, p| i % 11 == 0 && p > 3);
    let expected = Expected { width: WIDTH, height: HEIGHT, k: K };
    let path = dir.path().join("table.npy");
    write_npy(&full, &path).unwrap();
    let Table::Full(back) = read(&path, Some(expected)).unwrap() else { panic!("another kind") };
    assert_eq!(back.shape, full.shape);
    let bits = |t: &FullTable, i: usize, j: usize| t.channel(i, j).iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    for i in 0..full.shape.n_pixels() {
        for j in 0..=K {
            assert_eq!(bits(&back, i, j), bits(&full, i, j));
        }
    }

    let low = compress(&full, Rank::Fixed(3)).table;
    let path = dir.path().join("table.npz");
    write_npz(&low, &path).unwrap();
    let Table::LowRank(back) = read(&path, Some(expected)).unwrap() else { panic!("another kind") };
    assert_eq!((back.shape, back.rank, back.depth_rank), (low.shape, low.rank, low.depth_rank));
    // And all factors and ranges.
    assert!(back == low, "factors or ranges differ");
    let info = info(&path).unwrap();
    assert_eq!((info.kind, info.rank, info.positions, info.channels), ("low-rank", Some(3), 7, K));
    assert!(info.missing > 0.0 && info.depth_mm == Some([board(0, 7), board(6, 7)]), "{info:?}");
}

/// As numpy.save writes an array.
fn numpy(descr: &str, fortran: bool, shape: &[usize], data: &[u8]) -> Vec<u8> {
    let shape: Vec<String> = shape.iter().map(|n| format!("{n},")).collect();
    let fortran = if fortran { "True" } else { "False" };
    let header = format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': ({}), }}", shape.join(" "));
    let padded = format!("{header:<117}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((padded.len() as u16).to_le_bytes());
    bytes.extend(padded.as_bytes());
    bytes.extend(data);
    bytes
}

#[test]
fn foreign_layouts_are_read() {
    let dir = tempfile::tempdir().unwrap();
    // 2 rows, 3 columns, 2 positions, 1 channel: entry [y][x][p][c] is 1000 y + 100 x + 10 p + c + 1, doubles, Fortran
    // order.
    let value = |y: usize, x: usize, p: usize, c: usize| (1000 * y + 100 * x + 10 * p + c + 1) as f64;
    let mut doubles = Vec::new();
    for c in 0..2 {
        for p in 0..2 {
            for x in 0..3 {
                for y in 0..2 {
                    doubles.extend(value(y, x, p, c).to_le_bytes());
                }
            }
        }
    }
    let path = dir.path().join("foreign.npy");
    std::fs::write(&path, numpy("<f8", true, &[2, 3, 2, 2], &doubles)).unwrap();
    let Table::Full(t) = read(&path, Some(Expected { width: 3, height: 2, k: 1 })).unwrap() else { panic!("full") };
    for (y, x, p) in [(0, 0, 0), (1, 2, 1), (0, 1, 1)] {
        let got = [t.channel(y * 3 + x, 0)[p], t.channel(y * 3 + x, 1)[p]].map(f64::from);
        assert_eq!(got, [value(y, x, p, 0), value(y, x, p, 1)]);
    }

    // Factors in double precision and big-endian sizes, compressed, without our `range`.
    let path = dir.path().join("foreign.npz");
    let mut zip = zip::ZipWriter::new(std::fs::File::create(&path).unwrap());
    let doubles = |v: &[f64]| v.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let left = doubles(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    for (name, bytes) in [
        ("L_1", numpy("<f8", false, &[6, 1], &left)),
        ("R_1", numpy("<f8", false, &[1, 2], &doubles(&[0.1, 0.2]))),
        ("L_d", numpy("<f8", true, &[6, 1], &left)),
        ("R_d", numpy("<f8", false, &[1, 2], &doubles(&[100.0, 200.0]))),
        ("shape", numpy(">i4", false, &[4], &[2i32, 3, 2, 2].map(i32::to_be_bytes).concat())),
    ] {
        zip.start_file(format!("{name}.npy"), zip::write::SimpleFileOptions::default()).unwrap();
        std::io::Write::write_all(&mut zip, &bytes).unwrap();
    }
    zip.finish().unwrap();
    let table = read(&path, None).unwrap();
    let mut sample = [0.0; 2];
    assert!(table.sample(4, 1, &mut sample));
    assert!((sample[0] - 1.0).abs() < 1e-6 && sample[1] == 1000.0, "{sample:?}");
}

#[test]
fn files_that_are_no_table_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("bad.npy");
    let fails = |bytes: &[u8], why: &str| {
        std::fs::write(&path, bytes).unwrap();
        let e = read(&path, Some(Expected { width: 4, height: 2, k: 1 })).unwrap_err().to_string();
        assert!(e.contains("bad.npy") && e.contains(why), "{e} instead of {why}");
    };
    let floats = [0u8; 4 * 32];
    fails(&numpy("<f4", false, &[2, 4, 2, 2], &floats[..100]), "ends after");
    fails(&numpy("<f4", false, &[2, 3, 2, 2], &floats), "3 × 2 pixels and 1 channels");
    fails(&numpy("<f4", false, &[2, 4, 1, 3], &floats), "and 2 channels");
    fails(&numpy("<i4", false, &[2, 4, 2, 2], &floats), "holds '<i4' values");
    fails(&numpy("<f4", false, &[32], &floats), "not height × width × positions × (k + 1)");
    fails(&numpy("<f4", false, &[1000000, 1000000, 60000, 2], &floats), "the rig and its pattern set want");
    fails(b"hello", "bad.npy");
    fails(b"", "bad.npy");
    fails(b"PK and then nothing", "bad.npy");
    let low = compress(&table(1, 7, |_, _| false), Rank::Fixed(2)).table;
    let good = dir.path().join("good.npz");
    write_npz(&low, &good).unwrap();
    let whole = std::fs::read(&good).unwrap();
    fails(&whole, "40 × 30 pixels");
    for n in (0..whole.len()).step_by(whole.len() / 50) {
        fails(&whole[..n], "bad.npy");
    }
    let mut state = 3usize;
    for _ in 0..200 {
        let mut bad = whole.clone();
        for _ in 0..4 {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let at = (state >> 33) % bad.len();
            bad[at] = (state >> 20) as u8;
        }
        std::fs::write(&path, &bad).unwrap();
        // Whatever it is now: a table or an error that names the file.
        if let Err(e) = read(&path, None) {
            assert!(e.to_string().contains("bad.npy"), "{e}");
        }
    }
    assert!(read("/no/such.npy".as_ref(), None).unwrap_err().to_string().contains("/no/such.npy"));
}
