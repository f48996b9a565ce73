//! A USB3 Vision camera without one: a fake device answers the driver's commands and streams what a display shows,
//! late, noisy, with lost and damaged frames.

mod device;
mod registers;

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use nelu3d_capture::{Camera, CameraSettings, CaptureError, Slide, Usb3Camera};
use nelu3d_scan::image::{Channels, RawData};

use self::device::{FakeCamera, Faults};
use self::registers::{EXPOSURE, EXPOSURE_AUTO, GAIN, GAIN_AUTO, MODE, MONO12, PIXEL_FORMAT};
use super::scene::{Scene, assert_every_image_shows_what_was_asked, assert_shows};

fn connect(
    scene: &Arc<Mutex<Scene>>,
    device: &Arc<FakeCamera>,
    settings: &CameraSettings,
) -> Result<Usb3Camera<FakeCamera>, CaptureError> {
    let camera = Usb3Camera::with_device(device.open(), settings, Arc::new(AtomicBool::new(false)))?;
    Ok(camera.with_clock(scene.lock().unwrap().clock()))
}

/// What it says that such a device is refused with.
fn refusal(faults: Faults, exposure_us: Option<f64>) -> String {
    let scene = Scene::new(Duration::ZERO);
    let device = FakeCamera::new(&scene, faults);
    let refused = connect(&scene, &device, &CameraSettings { exposure_us, gain: None }).unwrap_err().to_string();
    assert!(!device.streams(), "it was refused and streams");
    refused
}

#[test]
fn every_image_shows_what_was_asked_whatever_is_lost() {
    for (latency, lost, damaged) in [(0, 0.0, 0.0), (50, 0.02, 0.05), (110, 0.05, 0.1)] {
        let scene = Scene::new(Duration::from_millis(latency));
        let device = FakeCamera::new(&scene, Faults { lost, damaged, ..Faults::default() });
        let settings = CameraSettings { exposure_us: Some(8000.0), gain: Some(2.0) };
        let mut camera = connect(&scene, &device, &settings).unwrap();
        assert_eq!((camera.channels(), camera.saturation()), (Channels::Mono, 4095.0));
        assert_eq!((device.float_register(EXPOSURE), device.float_register(GAIN)), (8000.0, 2.0));
        let set = [PIXEL_FORMAT, EXPOSURE_AUTO, GAIN_AUTO, MODE].map(|at| device.register(at));
        assert_eq!(set, [MONO12, 0, 0, 2]);
        assert_every_image_shows_what_was_asked(&scene, &mut camera);
        assert!(device.streams());
        drop(camera);
        assert!(!device.streams(), "it still streams");
    }
}

#[test]
fn frames_with_holes_are_dropped() {
    let scene = Scene::new(Duration::ZERO);
    let device = FakeCamera::new(&scene, Faults { lost: 0.1, damaged: 0.6, ..Faults::default() });
    let mut camera = connect(&scene, &device, &CameraSettings::default()).unwrap();
    let mut before = Duration::ZERO;
    for number in 0..40 {
        let frame = camera.next_frame().unwrap();
        assert_shows(&frame, Slide::White, "damaged frames between");
        assert!(matches!(frame.raw.data, RawData::U16(_)));
        assert!(frame.number == number && frame.at > before && frame.at <= scene.lock().unwrap().clock().elapsed());
        before = frame.at;
    }
}

#[test]
fn frames_that_waited_were_there_before() {
    let scene = Scene::new(Duration::ZERO);
    let device = FakeCamera::new(&scene, Faults::default());
    let mut camera = connect(&scene, &device, &CameraSettings::default()).unwrap();
    camera.next_frame().unwrap();
    std::thread::sleep(Duration::from_millis(500));
    let now = scene.lock().unwrap().clock().elapsed();
    let at: Vec<Duration> = (0..3).map(|_| camera.next_frame().unwrap().at).collect();
    // What is older was dropped, and none is taken for one that came when it was asked for.
    assert!(at[0] < now && at[0] + Duration::from_millis(300) > now, "{at:?} at {now:?}");
}

#[test]
fn what_a_camera_does_not_take_is_said() {
    let automatic = refusal(Faults { automatic: true, ..Faults::default() }, None);
    assert_eq!(
        automatic,
        "the camera U3V-7 (Retina): ExposureAuto stays Continuous; fix it in the camera's own program"
    );
    let short = refusal(Faults { longest_exposure: 5000.0, ..Faults::default() }, Some(8000.0));
    assert!(short.contains("ExposureTime became 5000, not 8000"), "{short}");
    let scene = Scene::new(Duration::ZERO);
    for (description, said) in [("<html>", "describes its features wrongly"), ("", "U3V-7")] {
        let device = FakeCamera::described(&scene, Faults::default(), description);
        let e = connect(&scene, &device, &CameraSettings::default()).unwrap_err().to_string();
        assert!(e.contains(said), "{e}");
    }
}

/// Takes as long as the driver is patient: less than all images take.
#[test]
fn a_camera_without_a_whole_frame_is_given_up() {
    let scene = Scene::new(Duration::ZERO);
    let device = FakeCamera::new(&scene, Faults { damaged: 1.0, ..Faults::default() });
    let mut camera = connect(&scene, &device, &CameraSettings::default()).unwrap();
    let begun = Instant::now();
    let e = camera.next_frame().unwrap_err().to_string();
    assert!(e.contains("delivers no whole frame (") && e.contains("see to its cable"), "{e}");
    assert!(begun.elapsed() < Duration::from_secs(30), "{:?}", begun.elapsed());
}

/// On this computer's own USB, whatever is plugged in.
#[test]
fn a_camera_that_is_not_plugged_in_is_said() {
    let stop = Arc::new(AtomicBool::new(false));
    let connected = Usb3Camera::connect(Some("no such serial number"), &CameraSettings::default(), stop);
    let e = connected.unwrap_err().to_string();
    assert!(e.starts_with("USB: ") && e.contains("; ") && !e.contains('\n'), "{e}");
}

#[test]
fn a_camera_that_a_killed_program_left_streaming_is_taken_over() {
    let scene = Scene::new(Duration::ZERO);
    let device = FakeCamera::new(&scene, Faults::default());
    device.leave_streaming();
    let mut camera = connect(&scene, &device, &CameraSettings::default()).unwrap();
    // Its format was locked.
    assert_eq!(camera.saturation(), 4095.0);
    assert_shows(&camera.next_frame().unwrap(), Slide::White, "taken over");
}

#[test]
fn a_camera_that_is_unplugged_or_stopped_ends_at_once() {
    let scene = Scene::new(Duration::ZERO);
    let device = FakeCamera::new(&scene, Faults::default());
    let mut camera = connect(&scene, &device, &CameraSettings::default()).unwrap();
    camera.next_frame().unwrap();
    let begun = Instant::now();
    device.unplug();
    let e = (0..).find_map(|_| camera.next_frame().err()).unwrap().to_string();
    assert!(e.starts_with("the camera U3V-7 (Retina): was unplugged; see to its plug"), "{e}");
    drop(camera);
    assert!(begun.elapsed() < Duration::from_secs(3), "{:?}", begun.elapsed());

    let device = FakeCamera::new(&scene, Faults::default());
    let stop = Arc::new(AtomicBool::new(false));
    let mut camera = Usb3Camera::with_device(device.open(), &CameraSettings::default(), stop.clone()).unwrap();
    camera.next_frame().unwrap();
    stop.store(true, Ordering::Relaxed);
    assert!(matches!(camera.next_frame(), Err(CaptureError::Stopped)));
}
