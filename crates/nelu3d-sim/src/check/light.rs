//! Checks of the light source and of what it shows.

use std::collections::HashSet;

use nelu3d_scan::pattern::{self, Pattern};
use nelu3d_scan::rig::Channels;

use super::rules::{Optics, aim, check, finite, name, optics, positive, within};
use crate::spec::{FilmSpec, LightSpec, PatternSetSpec, ProjectorSpec, Spec, SpecError};

/// Checks the light source, and the pattern sets that a projector shows.
pub(super) fn check_light(spec: &Spec) -> Result<(), SpecError> {
    let color = spec.camera.channels().is_some_and(|c| c != Channels::Mono);
    match &spec.light {
        LightSpec::Projector(p) => {
            check_projector(p)?;
            check_pattern_sets(&spec.pattern_sets, p.width, color)
        }
        LightSpec::Film(f) => {
            let none = spec.pattern_sets.is_empty();
            check(none, "pattern_sets", "not empty", "film has its own pattern; leave them out")?;
            check(color, "camera.channels", &spec.camera.channels, "film is colored: give it a color camera")?;
            check_film(f)
        }
    }
}

fn check_projector(p: &ProjectorSpec) -> Result<(), SpecError> {
    let intrinsics = [p.fx, p.fy, p.cx, p.cy];
    let distortion = p.optics().is_some();
    optics(&Optics { key: "light", size: [p.width, p.height], intrinsics, distortion })?;
    aim("light", p.position_mm, p.target_mm)?;
    positive("light.reference_mm", p.reference_mm)?;
    positive("light.focus_mm", p.focus_mm)?;
    within("light.sharp_sigma_px", p.sharp_sigma_px, 0.0, 50.0)?;
    within("light.aperture_mm", p.aperture_mm, 0.0, 1e3)?;
    within("light.vignetting", p.vignetting, 0.0, 100.0)?;
    within("light.black_leak", p.black_leak, 0.0, 0.99)?;
    for gamma in p.gamma.rgb() {
        within("light.gamma", gamma, 0.1, 10.0)?;
    }
    let good = p.fill_factor > 0.0 && p.fill_factor <= 1.0;
    check(good, "light.fill_factor", p.fill_factor, "give a number above 0, up to 1")?;
    finite("light.roll", &[p.roll])?;
    for tilt in p.focus_tilt {
        within("light.focus_tilt", tilt, -1.5, 1.5)?;
    }
    for v in p.primaries.as_flattened() {
        within("light.primaries", *v, 0.0, 1e3)?;
    }
    Ok(())
}

/// Checks what a projector of `width` px shows to a camera with or without `color`.
fn check_pattern_sets(sets: &[PatternSetSpec], width: usize, color: bool) -> Result<(), SpecError> {
    check(!sets.is_empty(), "pattern_sets", "empty", "give a projector a pattern to show")?;
    let mut names = HashSet::new();
    for set in sets {
        name("pattern_sets.name", &set.name, &mut names)?;
        // One row tells all about the settings, at no cost.
        let made = pattern::generate(&set.patterns, width, 1)
            .map_err(|source| SpecError::Pattern { set: set.name.clone(), source })?;
        check(!made.images.is_empty(), "pattern_sets.patterns", "empty", "give the set a pattern")?;
        let rgb = set.patterns.iter().any(Pattern::is_color);
        check(color || !rgb, "pattern_sets.patterns", "rgb", "a mono camera cannot tell its channels apart")?;
    }
    Ok(())
}

fn check_film(f: &FilmSpec) -> Result<(), SpecError> {
    aim("light", f.position_mm, f.target_mm)?;
    finite("light.flash_offset_mm", &f.flash_offset_mm)?;
    positive("light.reference_mm", f.reference_mm)?;
    for v in f.film_led.iter().chain(&f.flash_led) {
        let good = *v > 0.0 && *v <= 1e3;
        check(good, "light.film_led, flash_led", v, "give numbers above 0, up to 1000")?;
    }
    positive("light.film_mm", f.film_mm)?;
    within("light.lamp_sigma_mm", f.lamp_sigma_mm, 0.0, 1e3)?;
    positive("light.film_half_size_mm", f.film_half_size_mm[0].min(f.film_half_size_mm[1]))?;
    within("light.vignetting", f.vignetting, 0.0, 100.0)?;
    within("light.spread", f.spread, 0.0, std::f64::consts::PI)?;
    within("light.waves", f.waves as f64, 1.0, 64.0)?;
    positive("light.min_period_mm", f.min_period_mm)?;
    let good = f.max_period_mm >= f.min_period_mm && f.max_period_mm < 1e9;
    check(good, "light.max_period_mm", f.max_period_mm, "it must not be below min_period_mm")
}
