//! Checks that a color field belongs to a rig, a pattern set and a scene.

use nelu3d_scan::rig::{Capture, PatternSet, Shot};
use nelu3d_scan::{Camera, Rig};

use super::field::ColorField;

/// A color field that was made for something else.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the color field was made for {what} {field}, but the rig has {rig}: {remedy}")]
pub struct FieldMismatch {
    /// Name of what differs: "the camera", "the pattern set", "the image".
    pub what: &'static str,
    /// The field's value, in words.
    pub field: String,
    /// The rig's value, in words.
    pub rig: String,
    /// Remedy, in words.
    pub remedy: &'static str,
}

/// Returns the numbers by which a color field recognizes its camera: `[width, height, fx, fy, cx, cy]`, then the
/// distortion coefficients.
pub fn camera_key(camera: &Camera) -> Vec<f64> {
    let mut key = vec![camera.width as f64, camera.height as f64, camera.fx, camera.fy, camera.cx, camera.cy];
    key.extend_from_slice(camera.distortion.coeffs());
    key
}

/// Checks that a color field was made with a rig's camera and for a pattern set.
///
/// # Errors
///
/// The camera or the patterns differ.
pub fn check_field(rig: &Rig, set: &PatternSet, field: &ColorField) -> Result<(), FieldMismatch> {
    const REMEDY: &str = "calibrate this rig and set again, or choose the field that belongs to them";
    let (theirs, ours) = (&field.metadata.camera, &camera_key(&rig.camera));
    if ours != theirs {
        let (theirs, ours) = (differing(theirs, ours), differing(ours, theirs));
        return Err(FieldMismatch { what: "the camera", field: theirs, rig: ours, remedy: REMEDY });
    }
    if field.metadata.images != set.images || field.k() != set.images.len() * rig.channels.count() {
        let show = |name: &str, images: &[String]| format!("`{name}` ({})", images.join(", "));
        let (theirs, ours) = (show(&field.metadata.set, &field.metadata.images), show(&set.name, &set.images));
        return Err(FieldMismatch { what: "the pattern set", field: theirs, rig: ours, remedy: REMEDY });
    }
    Ok(())
}

/// Returns what of a camera's key is another than in `other`, with as many digits as it takes to see it.
fn differing(key: &[f64], other: &[f64]) -> String {
    const NAMES: [&str; 4] = ["fx", "fy", "cx", "cy"];
    let size = format!("{} × {} px", key[0], key[1]);
    if key[..2] != other[..2] {
        return size;
    }
    let of = |from: usize| key.iter().zip(other).skip(from).map(|(a, b)| (a != b).then_some(*a));
    let optics = NAMES.iter().zip(of(2)).filter_map(|(name, v)| Some(format!("{name} = {:?}", v?)));
    let mut words = vec![size];
    words.extend(optics);
    if key[6..] != other[6..] {
        words.push(if key.len() > 6 { format!("distortion {:?}", &key[6..]) } else { "no distortion".into() });
    }
    words.join(", ")
}

/// Checks that the mono images among a scene's patterns are those that were mono in the sweep: their codewords differ.
///
/// # Errors
///
/// A pattern has another number of channels than it had in the sweep.
pub fn check_mono(capture: &Capture, set: &PatternSet, shot: &Shot, field: &ColorField) -> Result<(), FieldMismatch> {
    // A field computed from projected images does not depend on any capture.
    let made_of_captures = field.metadata.source == "sweep";
    for (name, mono) in set.images.iter().zip(&capture.mono) {
        if made_of_captures && field.metadata.mono.contains(name) != *mono {
            let (now, then) = if *mono { ("one channel", "three") } else { ("three channels", "one") };
            return Err(FieldMismatch {
                what: "the image",
                field: format!("`{name}` with {then}"),
                rig: format!("{} with {now}", shot.dir.join(name).display()),
                remedy: "take this pattern the same way in the sweep and in scenes",
            });
        }
    }
    Ok(())
}
