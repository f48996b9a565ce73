//! Checks of sequences.

use super::object::check_object;
use super::rules::{check, finite, within};
use crate::spec::{LightSpec, SequenceSpec, Spec, SpecError};

/// Checks a sequence of a spec.
pub(super) fn check_sequence(spec: &Spec, s: &SequenceSpec) -> Result<(), SpecError> {
    let key = |field: &str| format!("sequences `{}`: {field}", s.name);
    check(s.fps > 0.0 && s.fps <= 1e7, key("fps"), s.fps, "give a number above 0, up to ten million")?;
    within(&key("frames"), s.frames as f64, 1.0, 100_000.0)?;
    within(&key("flash_delay_secs"), s.flash_delay_secs, -3600.0, 3600.0)?;
    within(&key("pattern_interval_secs"), s.pattern_interval_secs, 0.0, 3600.0)?;
    if let Some(set) = &s.pattern_set {
        let known = match &spec.light {
            LightSpec::Projector(_) => spec.pattern_sets.iter().any(|p| p.name == *set),
            LightSpec::Film(_) => false,
        };
        check(known, key("pattern_set"), format!("\"{set}\""), "give a name from pattern_sets, or leave it out")?;
    }
    for moving in &s.objects {
        check_object(&format!("sequences `{}`", s.name), &moving.object)?;
        let m = &moving.motion;
        finite(&key("objects.motion.velocity_mm_per_sec"), &m.velocity_mm_per_sec)?;
        finite(&key("objects.motion.acceleration_mm_per_sec2"), &m.acceleration_mm_per_sec2)?;
        finite(&key("objects.motion.angular_velocity"), &m.angular_velocity)?;
        finite(&key("objects.motion.vibration_hz, phase_per_sec"), &[m.vibration_hz, m.phase_per_sec])?;
    }
    Ok(())
}
