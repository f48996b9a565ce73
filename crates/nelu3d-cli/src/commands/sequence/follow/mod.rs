//! `nelu3d sequence --follow`: frames are shown as they arrive.
//!
//! One frame is shown at a time, the newest: what arrived while the one before was computed is left out of the view.
//! A frame is shown three times, each better and later: as the surface before it carried along by the motion of the
//! image, as its own surface after few steps, and, if there is nothing newer, as that after all of them.

mod arrivals;
mod view;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Result;
use nelu3d::Progress;
use nelu3d_capture::page::{LiveFiles, LivePage};
use nelu3d_report::{LIVE_SCRIPTS, LIVE_STYLE, live_page};
use nelu3d_scan::Rig;
use nelu3d_scan::rig::PatternSet;
use nelu3d_scan::statistics::median;

use self::arrivals::Arrivals;
use self::view::View;
use crate::args::SequenceArgs;
use crate::context::{CommandContext, HiddenSink};
use crate::paths::{default_field, load_field, shown};

/// Time between two looks at the folder.
const LOOK: Duration = Duration::from_millis(25);

/// Follows a folder until Ctrl-C, or until it has waited for the next frame for as long as was asked for. Returns
/// whether its frames are to be computed and written now.
pub(super) fn run(args: &SequenceArgs, rig: &Rig, set: &PatternSet, context: &CommandContext) -> Result<bool> {
    context.open_device(args.options.device)?;
    let path = args.field.clone().unwrap_or_else(|| default_field(rig, &set.name));
    let field = load_field(rig, set, &path)?;
    let mut arrivals = Arrivals::new(rig, set, folder(rig, &args.sequence));
    let subtitle = format!("Frames of {} under {}, as they arrive", shown(arrivals.folder()), set.name);
    let scripts = LIVE_SCRIPTS.map(|(name, text)| (name, text.to_owned())).to_vec();
    let title = arrivals.folder().file_name().unwrap_or_default().to_string_lossy().into_owned();
    let files = LiveFiles { page: live_page(&title, &subtitle), style: LIVE_STYLE.to_owned(), scripts };
    let mut view = View::new(rig, set, &field, args, LivePage::start(files, args.port)?);
    context.tell(&format!("open {} in a browser; Ctrl-C ends", view.address()));

    let idle = args.idle.map(Duration::from_secs_f64);
    let (mut seen, mut since): (Option<String>, _) = (None, Instant::now());
    while !context.progress.cancelled() {
        if let Some(newest) = arrivals.newest(seen.as_deref())? {
            context.progress.stage(&format!("frame {}", newest.frame.name));
            seen = Some(newest.frame.name.clone());
            view.show(newest, &context.silent());
            // From here: a machine that takes longer for a frame than `--idle` is busy, not idle.
            since = Instant::now();
        } else if refine(&mut view, &mut arrivals, seen.as_deref(), context)? {
            // Then there may be a newer frame.
            since = Instant::now();
        } else if idle.is_some_and(|idle| since.elapsed() > idle) {
            break;
        } else {
            std::thread::sleep(LOOK);
        }
    }
    let counts = &view.counts;
    let late_secs = median(&mut counts.late_secs.clone());
    let go_on = !context.progress.cancelled();
    let told = format!(
        "{} of {} frames were shown{}, {} refined, {} failed",
        counts.shown,
        arrivals.count(),
        late_secs.map_or(String::new(), |secs| format!(" {secs:.2} s after they were complete (median)")),
        counts.refined,
        counts.failed
    );
    if go_on {
        context.progress.stage(&told);
        return Ok(true);
    }
    let answer = serde_json::json!({
        "frames": arrivals.count(), "shown": counts.shown, "refined": counts.refined, "failed": counts.failed,
        "left_out": counts.left_out, "late_secs": late_secs,
    });
    let more = format!("nelu3d sequence {} {} computes and writes them all", shown(&args.rig), args.sequence);
    context.answer(&answer, || format!("{told}\n{more}"))?;
    Ok(false)
}

/// Refines what is shown while no newer frame is there. Returns whether there was something to refine.
fn refine(
    view: &mut View<'_>,
    arrivals: &mut Arrivals<'_>,
    seen: Option<&str>,
    context: &CommandContext,
) -> Result<bool> {
    if !view.can_refine() {
        return Ok(false);
    }
    let (done, newer) = (AtomicBool::new(false), Arc::new(AtomicBool::new(false)));
    let progress = Progress::new(Arc::new(HiddenSink), newer.clone());
    std::thread::scope(|scope| {
        let (done, newer) = (&done, &newer);
        let watching = scope.spawn(move || -> Result<()> {
            while !done.load(Ordering::Relaxed) {
                if context.progress.cancelled() || arrivals.newest(seen)?.is_some() {
                    newer.store(true, Ordering::Relaxed);
                    break;
                }
                std::thread::sleep(LOOK);
            }
            Ok(())
        });
        view.refine(&progress);
        done.store(true, Ordering::Relaxed);
        watching.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
        Ok(true)
    })
}

/// Returns the folder of a sequence, which need not exist yet: a path, or a name under RIG/sequences.
fn folder(rig: &Rig, sequence: &str) -> PathBuf {
    let known = rig.root.join("sequences").join(sequence);
    let path = Path::new(sequence);
    if !known.is_dir() && (path.is_dir() || path.components().count() > 1) { path.to_path_buf() } else { known }
}
