//! A capture against everything that displays and cameras do wrong: no frame is accepted that shows something else.

use std::collections::HashMap;
use std::f32::consts::TAU;

use nelu3d_capture::simulated::{SimulatedFaults, SimulatedRoom};
use nelu3d_capture::{CaptureError, CaptureSession, ExposureVerdict, Slide};
use nelu3d_scan::image::{Raw, RawData};

const W: usize = 64;
const H: usize = 48;

/// Images of a wall with a checkered poster under `patterns` sinusoids, white, and black, 8 bits.
fn wall(patterns: usize, turn: f32) -> HashMap<Slide, Raw> {
    let albedo = |x: usize, y: usize| if (x / 6 + y / 6).is_multiple_of(2) { 0.9 } else { 0.35 + 0.1 * turn.sin() };
    let image = |light: &dyn Fn(usize) -> f32| {
        let code = |i: usize| (8.0 + 210.0 * albedo(i % W, i / W) * light(i % W)).round() as u8;
        Raw { width: W, height: H, channels: 1, data: RawData::U8((0..W * H).map(code).collect()) }
    };
    let mut all = HashMap::from([(Slide::White, image(&|_| 1.0)), (Slide::Black, image(&|_| 0.0))]);
    for i in 0..patterns {
        let wave = |x: usize| 0.5 + 0.5 * (TAU * (x as f32 / 13.0 + i as f32 / patterns as f32) + turn).cos();
        all.insert(Slide::Pattern(i), image(&wave));
    }
    all
}

const BAD: SimulatedFaults = SimulatedFaults {
    latency_frames: 0.0,
    jitter_frames: 0.9,
    loss: 0.01,
    stale: 0.05,
    stale_depth: 5,
    duplicated: 0.02,
    read_noise: 1.5,
    shot_noise: 0.02,
    automatic_exposure: 0.0,
};

/// Takes folders until so many frames were accepted; returns how many were looked at and accepted, all of them right.
fn accepted_frames(latency_frames: f64, seed: u64, wanted: usize) -> [usize; 2] {
    const PATTERNS: usize = 8;
    let room = SimulatedRoom::new(wall(PATTERNS, 0.0), SimulatedFaults { latency_frames, ..BAD }, seed);
    let (mut display, mut camera) = room.devices();
    let mut session = CaptureSession::start(&mut display, &mut camera).unwrap();
    let (mut delivered, mut accepted) = (0, 0);
    for turn in 0.. {
        room.set_images(wall(PATTERNS, turn as f32));
        let images = session.take(PATTERNS).unwrap_or_else(|e| panic!("latency {latency_frames}, {turn}: {e}"));
        assert_eq!(room.label(images.white.number), Some(Slide::White));
        assert_eq!(room.label(images.black.number), Some(Slide::Black));
        for (i, frame) in images.patterns.iter().enumerate() {
            assert_eq!(room.label(frame.number), Some(Slide::Pattern(i)), "latency {latency_frames}, folder {turn}");
        }
        delivered += images.counts.delivered;
        accepted += PATTERNS + 2;
        if accepted >= wanted {
            break;
        }
    }
    [delivered, accepted]
}

/// Latency from 0 to 5 frames with almost two frames of jitter, 1 % lost, 5 % stale, 2 % delivered twice.
#[test]
fn no_wrong_frame_is_accepted_in_ten_thousand() {
    let (mut delivered, mut accepted) = (0, 0);
    for latency in 0..=5u32 {
        let [d, a] = accepted_frames(f64::from(latency), 7 + u64::from(latency), 1670);
        (delivered, accepted) = (delivered + d, accepted + a);
    }
    assert!(accepted >= 10_000);
    println!("{accepted} frames accepted of {delivered} delivered, none wrong");
    // A rule that waits for ever would pass the above.
    assert!(delivered < 10 * accepted, "{delivered} frames for {accepted}");
}

#[test]
fn the_latency_is_measured() {
    for latency_frames in [0.0, 1.0, 4.0] {
        let faults = SimulatedFaults { latency_frames, jitter_frames: 0.5, ..SimulatedFaults::default() };
        let room = SimulatedRoom::new(wall(1, 0.0), faults, 3);
        let (mut display, mut camera) = room.devices();
        let session = CaptureSession::start(&mut display, &mut camera).unwrap();
        let timing = session.timing();
        let frames = |secs: f64| secs / timing.frame_secs;
        assert!((timing.frame_secs - 1.0 / 30.0).abs() < 1e-3, "{timing:?}");
        // The change, up to a frame until the next exposure begins, and its own time.
        let (min, max) = (frames(timing.latency_min_secs), frames(timing.latency_max_secs));
        assert!(
            min > latency_frames - 0.5 && max < latency_frames + 0.5 + 1.0 + 0.8,
            "{latency_frames}: {min} to {max}"
        );
        let noise = session.noise();
        assert!((0.7..1.3).contains(&(noise.offset / (1.5f64.powi(2) + 8.0 * 0.02 + 1.0 / 12.0))), "{noise:?}");
        assert!(noise.slope < 0.04 && noise.flicker < 0.005 && !noise.none, "{noise:?}");
        assert_eq!(session.exposure(0.0, 255.0).verdict, ExposureVerdict::Good);
    }
}

/// Without noise, a frame that is delivered twice cannot be told from two frames; torn ones are delivered twice, too.
#[test]
fn a_camera_without_noise_is_no_easier_to_fool() {
    let faults = SimulatedFaults { read_noise: 0.0, shot_noise: 0.0, duplicated: 0.1, latency_frames: 2.0, ..BAD };
    let room = SimulatedRoom::new(wall(8, 0.0), faults, 5);
    let (mut display, mut camera) = room.devices();
    let mut session = CaptureSession::start(&mut display, &mut camera).unwrap();
    assert!(session.noise().none);
    for _ in 0..40 {
        let images = session.take(8).unwrap();
        for (i, frame) in images.patterns.iter().enumerate() {
            assert_eq!(room.label(frame.number), Some(Slide::Pattern(i)));
        }
    }
}

/// A pattern that looks like white, two that look the same, and one that is black: shown again after a flash.
#[test]
fn slides_that_look_alike_are_told_apart_by_a_flash() {
    let mut images = wall(5, 0.0);
    images.insert(Slide::Pattern(0), images[&Slide::Black].clone());
    images.insert(Slide::Pattern(2), images[&Slide::Pattern(1)].clone());
    images.insert(Slide::Pattern(4), images[&Slide::White].clone());
    for seed in 0..10 {
        let room = SimulatedRoom::new(images.clone(), SimulatedFaults { latency_frames: 3.0, ..BAD }, seed);
        let (mut display, mut camera) = room.devices();
        let mut session = CaptureSession::start(&mut display, &mut camera).unwrap();
        let taken = session.take(5).unwrap();
        for (i, frame) in taken.patterns.iter().enumerate() {
            assert_eq!(room.label(frame.number), Some(Slide::Pattern(i)), "seed {seed}");
        }
        assert!(taken.counts.shown_again >= 3, "{:?}", taken.counts);
    }
}

fn refusal(images: HashMap<Slide, Raw>, faults: SimulatedFaults) -> CaptureError {
    let room = SimulatedRoom::new(images, faults, 1);
    let (mut display, mut camera) = room.devices();
    CaptureSession::start(&mut display, &mut camera).unwrap_err()
}

#[test]
fn a_covered_lens_and_automatic_exposure_are_refused() {
    let mut covered = wall(1, 0.0);
    covered.insert(Slide::White, covered[&Slide::Black].clone());
    let e = refusal(covered, SimulatedFaults::default());
    assert!(matches!(e, CaptureError::NoLight { .. }) && e.to_string().contains("lens cap"), "{e}");
    for automatic_exposure in [0.02, 0.1, 0.5] {
        let room =
            SimulatedRoom::new(wall(1, 0.0), SimulatedFaults { automatic_exposure, ..SimulatedFaults::default() }, 1);
        let (mut display, mut camera) = room.devices();
        let started = CaptureSession::start(&mut display, &mut camera);
        let Err(e) = started else { panic!("{automatic_exposure}: {started:?}") };
        // Either it is caught at it, or the picture never settles.
        assert!(
            matches!(e, CaptureError::ExposureNotLocked { .. } | CaptureError::Unsteady { .. }),
            "{automatic_exposure}: {e}"
        );
    }
}

#[test]
fn a_board_that_moves_is_refused_and_taken_again_when_it_rests() {
    let room = SimulatedRoom::new(wall(3, 0.0), SimulatedFaults::default(), 2);
    let (mut display, mut camera) = room.devices();
    let mut session = CaptureSession::start(&mut display, &mut camera).unwrap();
    room.shake(3);
    let e = session.take(3).unwrap_err();
    assert!(matches!(e, CaptureError::Unsteady { .. } | CaptureError::Moved { .. }), "{e}");
    room.shake(0);
    assert_eq!(session.take(3).unwrap().patterns.len(), 3);
}
