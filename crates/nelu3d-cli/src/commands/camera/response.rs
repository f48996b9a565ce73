//! `nelu3d camera --response`: how the camera's codes follow light, from images whose light adds up or stands in known
//! ratios.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, anyhow, bail};
use nelu3d_scan::image::{Raw, Response, decode};
use nelu3d_scan::output::write_atomic;
use nelu3d_scan::pattern::Superposition;
use nelu3d_scan::radiometry::{LightRelation, ResponseEstimator, ResponseReport};
use nelu3d_scan::rig::{RIG_FILE, Rig, Shot, state_response};

use super::folder::{ENDINGS, images};
use crate::args::CameraArgs;
use crate::context::CommandContext;
use crate::paths::shown;

/// Folder of a rig for the images of [`Superposition`], white and black.
pub(crate) const RESPONSE_FOLDER: &str = "response";
/// File of a rig for a measured curve.
pub(crate) const RESPONSE_FILE: &str = "response.json";
/// Positions of a sweep that are looked at.
const MAX_POSITIONS: usize = 6;
/// Images with inverses that are looked at, of those with the finest stripes.
const MAX_INVERSES: usize = 6;

/// A curve, what it says of itself, and from what it was measured.
pub(crate) struct MeasuredResponse {
    pub(crate) response: Response,
    pub(crate) report: ResponseReport,
    source: String,
}

/// Runs the command.
pub(super) fn run(args: &CameraArgs, context: &CommandContext) -> Result<()> {
    let path = &args.source;
    let is_rig = path.join(RIG_FILE).is_file() || path.file_name().is_some_and(|n| n == RIG_FILE);
    context.progress.stage("measure the camera's response");
    let rig = is_rig.then(|| Rig::open_sensor(path)).transpose()?;
    let measured = match (&rig, &args.response.exposures) {
        (Some(rig), Some(secs)) => {
            from_exposures(&rig.root.join(RESPONSE_FOLDER), secs, [rig.black_level, rig.saturation])?
        }
        (None, Some(secs)) => from_exposures(path, secs, levels(args)?)?,
        (Some(rig), None) => from_rig(rig, context)?,
        (None, None) => from_superposition(path, levels(args)?)?,
    };
    context.stop_if_asked()?;
    let name = measured.response.name().to_owned();
    let written = match (&rig, &args.output) {
        (Some(rig), None) => {
            state(rig, &measured.response, args.force, context)?;
            format!("response = {name:?} in {}", shown(&rig.root.join(RIG_FILE)))
        }
        (_, output) => {
            let file = output.clone().unwrap_or_else(|| RESPONSE_FILE.into());
            if file.exists() && !args.force {
                bail!("{}: exists; give --force to replace it, or another file with -o FILE", shown(&file));
            }
            let json = measured.response.to_json();
            write_atomic(&file, |w| w.write_all(json.as_bytes()))?;
            shown(&file)
        }
    };
    let json = serde_json::json!({ "response": name, "source": measured.source, "written": written,
        "report": measured.report });
    context.answer(&json, || format!("{}written   {written}\n", text(&measured)))?;
    Ok(())
}

/// Writes a response into a rig that states none, or the same, or may be changed.
fn state(rig: &Rig, response: &Response, force: bool, context: &CommandContext) -> Result<()> {
    let before = rig.response.as_ref().map(Response::name);
    if before.is_some_and(|before| before != response.name()) && !force {
        bail!(
            "{}: says response = {:?}, but {:?} was measured; give --force to replace it",
            shown(&rig.root.join(RIG_FILE)),
            before.unwrap_or_default(),
            response.name()
        );
    }
    state_response(&rig.root, response)?;
    if rig.root.join("fields").exists() && rig.response.as_ref() != Some(response) {
        context.progress.warn("the color fields were made with another response: run `nelu3d calibrate` again");
    }
    Ok(())
}

/// Returns the codes for no light and for clipped values of a folder's files.
fn levels(args: &CameraArgs) -> Result<[f64; 2]> {
    let (_, first) = images(&args.source)?.swap_remove(0);
    let max = decode(&first, None)?.depth().max().unwrap_or(1.0);
    let saturation = args.response.saturation.unwrap_or(max);
    if saturation <= args.response.black_level {
        bail!("--saturation {saturation} is not above --black-level {}", args.response.black_level);
    }
    Ok([args.response.black_level, saturation])
}

/// Measures from a rig's folder for it, or else from the images of its sweep that have inverses.
fn from_rig(rig: &Rig, context: &CommandContext) -> Result<MeasuredResponse> {
    let levels = [rig.black_level, rig.saturation];
    let folder = rig.root.join(RESPONSE_FOLDER);
    if folder.exists() {
        return from_superposition(&folder, levels);
    }
    let set = rig.pattern_sets.iter().find(|set| !set.inverse.is_empty() && is_binary(rig, &set.images));
    let Some(set) = set else {
        bail!(
            "{}: has neither a folder {RESPONSE_FOLDER} nor a pattern set of two-valued images with inverses; take one \
             with `nelu3d capture RIG --response measure`, or show the images of `nelu3d patterns superposition` and \
             put their captures there",
            shown(&rig.root)
        );
    };
    let positions = rig.positions()?;
    let step = positions.len().div_ceil(MAX_POSITIONS);
    let first = set.images.len().saturating_sub(MAX_INVERSES);
    let pairs: Vec<(&String, &String)> = set.images.iter().zip(&set.inverse).skip(first).collect();
    let mut estimator = ResponseEstimator::new(levels[0], levels[1]);
    let shots: Vec<&Shot> = positions.iter().step_by(step).collect();
    for (i, shot) in shots.iter().enumerate() {
        context.progress.tick(i, shots.len());
        context.stop_if_asked()?;
        let mut names = vec![&rig.white, &rig.black];
        names.extend(pairs.iter().flat_map(|(image, inverse)| [*image, *inverse]));
        let raws = names.iter().map(|name| decode(&shot.dir.join(name), None)).collect::<Result<Vec<Raw>, _>>()?;
        let relations: Vec<LightRelation> =
            (0..pairs.len()).map(|p| LightRelation::sum(2 + 2 * p, 3 + 2 * p, 0, 1, p)).collect();
        estimator
            .add(&raws.iter().collect::<Vec<_>>(), &relations)
            .map_err(|e| anyhow!("{}: {e}", shown(&shot.dir)))?;
    }
    let source = format!("{} images and their inverses at {} positions, set {}", pairs.len(), shots.len(), set.name);
    finish(&estimator, &rig.root, source)
}

/// Returns whether the light source shows only two values in these images, as far as the rig keeps them: in between it
/// makes light of codes in a way of its own.
fn is_binary(rig: &Rig, names: &[String]) -> bool {
    let extreme = |raw: &Raw| match &raw.data {
        nelu3d_scan::image::RawData::U8(v) => v.iter().all(|c| matches!(c, 0 | 255)),
        nelu3d_scan::image::RawData::U16(v) => v.iter().all(|c| matches!(c, 0 | 65535)),
        nelu3d_scan::image::RawData::Float(v) => v.iter().all(|c| *c == 0.0 || *c == 1.0),
    };
    names.iter().all(|name| {
        let file = rig.projected(name);
        !file.exists() || decode(&file, None).is_ok_and(|raw| extreme(&raw))
    })
}

/// Measures from the captures of [`Superposition`] and of black in a folder.
pub(crate) fn from_superposition(folder: &Path, levels: [f64; 2]) -> Result<MeasuredResponse> {
    let find = |stem: &str| -> Result<PathBuf> {
        let mut files = ENDINGS.iter().map(|ending| folder.join(format!("{stem}.{ending}")));
        files.find(|file| file.exists()).with_context(|| {
            format!(
                "{}: has no image {stem}; show the images of `nelu3d patterns superposition` and put their captures \
                 there under the same names, or give the exposure times of its images with --exposures",
                shown(folder)
            )
        })
    };
    let stems = (0..Superposition::IMAGES).map(|i| format!("superposition_{i:02}")).chain(["black".into()]);
    let raws = stems.map(|stem| Ok(decode(&find(&stem)?, None)?)).collect::<Result<Vec<Raw>>>()?;
    let mut estimator = ResponseEstimator::new(levels[0], levels[1]);
    let relations = LightRelation::superposition(Superposition::IMAGES);
    estimator.add(&raws.iter().collect::<Vec<_>>(), &relations).map_err(|e| anyhow!("{}: {e}", shown(folder)))?;
    finish(&estimator, folder, format!("{} images whose light adds up", raws.len()))
}

/// Measures from images of a still scene with these exposure times.
fn from_exposures(folder: &Path, secs: &[f64], levels: [f64; 2]) -> Result<MeasuredResponse> {
    let files = images(folder)?;
    if files.len() != secs.len() || secs.len() < 3 {
        bail!(
            "{}: has {} images, and --exposures gives {} times; give one for each, in the order of the names, for 3 \
             images or more",
            shown(folder),
            files.len(),
            secs.len()
        );
    }
    let raws = files.iter().map(|(_, file)| decode(file, None)).collect::<Result<Vec<Raw>, _>>()?;
    let mut estimator = ResponseEstimator::new(levels[0], levels[1]);
    let relations = LightRelation::exposure_series(secs);
    estimator.add(&raws.iter().collect::<Vec<_>>(), &relations).map_err(|e| anyhow!("{}: {e}", shown(folder)))?;
    finish(&estimator, folder, format!("{} exposures", raws.len()))
}

fn finish(estimator: &ResponseEstimator, path: &Path, source: String) -> Result<MeasuredResponse> {
    let (response, report) = estimator.finish(RESPONSE_FILE).map_err(|e| anyhow!("{}: {e}", shown(path)))?;
    Ok(MeasuredResponse { response, report, source })
}

/// Returns a measurement in words.
fn text(measured: &MeasuredResponse) -> String {
    let (r, mut text) = (&measured.report, String::new());
    let _ = writeln!(text, "source    {}, {} relations in parts of the picture", measured.source, r.relations);
    for c in &r.candidates {
        let chosen = if c.chosen { " ← used" } else { "" };
        let _ =
            writeln!(text, "curve     {}, {} parameters: held out {:.2} σ{chosen}", c.name, c.parameters, c.held_out);
    }
    let _ = writeln!(
        text,
        "light     adds up to {:.2} % ({:.2} % if codes were light)",
        r.adds_up_percent, r.adds_up_linear_percent
    );
    let _ = writeln!(
        text,
        "response  about code^{:.2}; {:.1} % from a straight line, ± {:.2} %, between {:.0} and {:.0} % of the scale",
        r.gamma,
        r.from_linear_percent,
        r.standard_error_percent,
        100.0 * r.range[0],
        100.0 * r.range[1]
    );
    text
}
