//! Rejects pixels whose depth is not supported by what was measured. This is where a refined pixel loses its depth.

mod beyond;
mod chance;
#[doc(hidden)]
pub mod components;
#[doc(hidden)]
pub mod continuation;
#[doc(hidden)]
pub mod facing_away;
#[doc(hidden)]
pub mod fading;
#[doc(hidden)]
pub mod judgement;
mod outside;
#[doc(hidden)]
pub mod partly_covered;
#[doc(hidden)]
pub mod pieces;
mod settings;

use std::cell::OnceCell;

use crate::reconstruct::context::Context;
use crate::reconstruct::error::Failure;
use crate::reconstruct::judge::disagreeing;
use crate::reconstruct::light_fractions::LightFractionPrior;
use crate::reconstruct::maps::local_mean;
use crate::reconstruct::refine::Refined;
use crate::reconstruct::scene::Scene;
use crate::sensor::{CodewordStatistics, Support, judge_codewords};
use crate::surface::{Links, MAX_SLOPE, PixelStatus, reject_small_components};
use crate::verdict::Verdict;
use beyond::explained_beyond;
use chance::{Along, ForeignCodewords};
use components::reject_unexplained_components;
use continuation::reject_continuations;
use facing_away::reject_facing_away;
use fading::reject_fading;
use judgement::Alternatives;
use outside::{Continued, reject_outside};
use partly_covered::reject_partly_covered;
pub use settings::FilterSettings;

/// Returns the depth of every valid pixel (camera z, mm; NaN elsewhere) and notes in the scene's measurements why the
/// others are rejected: outside the calibrated volume, unexplained codeword, mixed pixel at a depth discontinuity or at
/// an outline, turned away from the light, component too small or explained by chance. `prior` is that of light that
/// did not come directly from the light source, `step` the spacing of the depth hypotheses in 1/z, 1/mm. With it comes
/// what supports the surface where much of the picture is explained nowhere; `None` where that cannot be told.
pub(crate) fn filter(
    scene: &mut Scene<'_>,
    refined: &Refined,
    step: f32,
    settings: &FilterSettings,
    prior: &LightFractionPrior,
    cx: &mut Context<'_>,
) -> Result<(Vec<f32>, Option<Support>), Failure> {
    cx.clock.begin("filter");
    let Scene { camera, rays, field, measurements: m, .. } = scene;
    let mut depth: Vec<f32> = refined.inv_z.iter().map(|v| 1.0 / v).collect();
    let chi2 = local_mean(&refined.chi2, m.width, m.height, 2);
    let mut known: Vec<f32> = chi2.iter().copied().filter(|c| c.is_finite()).collect();
    let [least, most] = settings.max_chi2;
    known.sort_unstable_by(f32::total_cmp);
    let max_chi2 = known.get(known.len() / 5).map_or(most, |c| (settings.chi2_over_good * c).clamp(least, most));
    tracing::debug!(max_chi2, "limit of single pixels");
    for i in 0..m.n() {
        if !depth[i].is_finite() {
            continue;
        }
        let [near, far] = rays.range[i];
        let dir_z = rays.dir_z(i);
        let t = depth[i] / dir_z;
        // The ends of the volume reject what may lie beyond, they do not collect it.
        let (last, first) = (1.0 / (near * dir_z) - 0.5 * step, 1.0 / (far * dir_z) + 0.5 * step);
        let inside = refined.inv_z[i] >= first && refined.inv_z[i] <= last;
        if !(inside && rays.is_calibrated(i, rays.in_frame(i).at(f64::from(t)).q, &field.validity)) {
            m.status[i] = PixelStatus::OutsideVolume;
        } else if chi2[i] > max_chi2 || refined.ambient[i] > settings.max_indirect {
            m.status[i] = PixelStatus::Ambiguous;
        } else {
            continue;
        }
        depth[i] = f32::NAN;
    }
    let links = Links::new(&depth, camera, MAX_SLOPE);
    for i in links.at_jumps(&depth, m.width) {
        if refined.chi2[i] > settings.max_edge_chi2 {
            m.status[i] = PixelStatus::DepthDiscontinuity;
            depth[i] = f32::NAN;
        }
    }
    reject_partly_covered(&mut depth, m, settings.least_covered);
    let mut status = std::mem::take(&mut scene.measurements.status);
    let foreign = ForeignCodewords::new(scene, &depth);
    let noise_is_known = scene.field.metadata.is_at_its_noise();
    let explained_as_well =
        |pixels: &[usize], along: Along| foreign.explained_as_well(pixels, scene, refined, prior, step, along);
    let alternatives = |pixels: &[usize]| {
        let is_telling = |[share, _]: &[f32; 2]| *share < settings.unknown_chance;
        let explained = explained_as_well(pixels, Along::Ray)
            .or_else(|| explained_as_well(pixels, Along::Other).filter(is_telling));
        let (by_chance, foreign_chi2) = (explained.map(|[share, _]| share), explained.map_or(0.0, |[_, ratio]| ratio));
        let chance = by_chance.unwrap_or(settings.unknown_chance);
        let beyond = explained_beyond(pixels, scene, refined, prior, step, chance);
        Alternatives { by_chance, foreign_chi2, beyond }
    };
    let is_lit: Vec<bool> = status.iter().map(|status| status.is_measured()).collect();
    let decoded = OnceCell::new();
    let continued = || decoded.get_or_init(|| Continued::decode(|i| is_lit[i], scene, prior, cx)).as_ref();
    let is_elsewhere = |i: usize| continued().is_some_and(|continued| continued.explains(i, scene));
    let camera = scene.camera;
    let light = &scene.measurements.contrast;
    reject_unexplained_components(
        &mut depth,
        &mut status,
        camera,
        (refined, light),
        settings,
        noise_is_known,
        (alternatives, is_elsewhere),
    );
    let by_chance = |pixels: &[usize]| explained_as_well(pixels, Along::Ray).map(|[share, _]| share);
    let asked = (by_chance, is_elsewhere);
    let is_unsupported = reject_fading(&mut depth, &mut status, scene, refined, prior, settings, asked);
    reject_continuations(&mut depth, &mut status, scene, refined, prior, step, settings.min_component);
    reject_outside(&mut depth, &mut status, scene, refined, settings, continued);
    let evidence = is_unsupported.map(|is_unsupported| {
        let elsewhere = (0..status.len()).filter(|i| status[*i] == PixelStatus::Ambiguous && is_elsewhere(*i)).count();
        (is_unsupported, elsewhere)
    });
    scene.measurements.status = status;
    let Scene { camera, rays, field, measurements: m, .. } = scene;
    // After whole components: what is left of one whose worst part is gone may look better than all of it did.
    if let Some(light) = field.frame.center() {
        reject_facing_away(&mut depth, &mut m.status, camera, &rays.plane, light.coords.cast());
    }
    reject_small_components(&mut depth, &mut m.status, camera, settings.min_component);
    for i in 0..m.n() {
        if depth[i].is_nan() && m.status[i] == PixelStatus::Valid {
            // Decoding at reduced resolution does not tell which of the full image's rays miss the volume.
            let [near, far] = rays.range[i];
            m.status[i] = if near > far { PixelStatus::OutsideVolume } else { PixelStatus::Ambiguous };
        }
    }
    if depth.iter().all(|z| z.is_nan()) {
        return Err(nothing_left(scene));
    }
    let support = evidence.map(|(is_unsupported, elsewhere)| {
        let kept = (0..m.n()).filter(|i| depth[*i].is_finite());
        let unsupported = kept.clone().filter(|i| is_unsupported[*i]).count() as f64 / kept.count() as f64;
        Support { unsupported, elsewhere }
    });
    Ok((depth, support))
}

/// Returns the failure of a scene in which every pixel is rejected: what its captures tell, or else what most of the
/// pixels that are not dark were rejected for.
pub(crate) fn nothing_left(scene: &Scene<'_>) -> Failure {
    let m = &scene.measurements;
    let rejected = PixelStatus::describe_rejections(&m.status, "the calibrated volume");
    let (statistics, _) = CodewordStatistics::of_scene(m, &m.status);
    let count = |s: PixelStatus| m.status.iter().filter(|v| **v == s).count();
    let reasons = [
        (PixelStatus::Saturated, "expose for less"),
        (PixelStatus::OutsideVolume, "put the object where the board was swept"),
        (
            PixelStatus::Ambiguous,
            "check that the object stands where the board was swept, and that white, black, and patterns are this \
             scene's, in the set's order, neither mirrored nor with another gamma or exposure than in the sweep",
        ),
    ];
    let most = reasons.into_iter().max_by_key(|(status, _)| count(*status)).filter(|(status, _)| {
        // A scene without light has nothing else to tell.
        20 * count(*status) > m.n()
    });
    let remedy = most.map(|(_, remedy)| remedy);
    // A note is no reason, and codewords alone do not tell a pattern that was dark from an object that had one of its
    // stripes, and lies elsewhere or is mirrored.
    let images = &scene.field.metadata.images;
    let findings = judge_codewords(&statistics, None, images);
    let other = disagreeing(scene, |_| false);
    let found = other.iter().chain(&findings).find(|found| found.verdict != Verdict::Good);
    let found = found.map(|found| format!("{}: {}", found.sentence, found.remedy));
    let told = match (found, remedy) {
        (Some(found), Some(remedy)) => format!("{found}, or {remedy}"),
        (Some(found), None) => found,
        (None, remedy) => remedy.unwrap_or("expose for longer, and check that the light was on in white").to_owned(),
    };
    Failure::Nothing(format!("{rejected}; {told}"))
}
