//! `nelu3d experiment`: the paper's tables and figures, and studies of our own, each a file in `experiments/`.
//!
//! [`file`] is what such a file says; [`plan`] makes commands of it (simulate, calibrate, reconstruct or decode,
//! evaluate) and reads their answers; [`step`] runs each command once, however often the experiment is started;
//! [`table`], [`plot`] and [`page`] show the numbers, and [`judged_claim`] holds them against what the file claims. To
//! add an experiment, write its file and add it to [`file::BUILT_IN`].

mod cell;
mod claim;
mod columns;
mod file;
mod judged_claim;
mod names;
mod page;
mod placeholders;
mod plan;
mod plot;
mod rig;
mod step;
mod table;
mod usage;

use anyhow::{Context, Result};
use nelu3d_scan::output::{create_dir, write_atomic};

use crate::args::ExperimentArgs;
use crate::context::CommandContext;
use crate::paths::shown;
use file::{BUILT_IN, Experiment};
use judged_claim::JudgedClaim;
use step::StepRunner;
use table::{ExperimentNumbers, TableCell};

/// Runs the command.
pub(crate) fn run(args: &ExperimentArgs, context: &CommandContext) -> Result<()> {
    let Some(name) = &args.name else { return list(context) };
    let (name, mut experiment) = Experiment::read(name, args.quick)?;
    if let Some(seeds) = &args.seeds {
        experiment.seeds.clone_from(seeds);
    }
    usage::check(&experiment).with_context(|| format!("experiment {name}"))?;
    if args.output.to_str().is_none() {
        // Commands and their records are text.
        anyhow::bail!("{}: is no UTF-8, which a study needs; give another folder with -o", shown(&args.output));
    }
    context.open_device(args.device)?;
    let dir = args.output.join(if args.quick { format!("{name}-quick") } else { name.clone() });
    create_dir(&dir)?;
    let mut runner = StepRunner::new(&args.output, args.device, args.reuse, context)?;
    let cells = plan::run(&experiment, &args.output, &dir, &mut runner)?;
    context.stop_if_asked()?;

    context.progress.stage("write the tables");
    let numbers = ExperimentNumbers::of(&experiment, &cells);
    let claims: Vec<JudgedClaim> =
        experiment.claims.iter().map(|c| JudgedClaim::of(c, &numbers)).collect::<Result<_>>()?;
    let lines: Vec<String> = claims.iter().map(JudgedClaim::line).collect();
    let made = made();
    let mut plots = Vec::new();
    for (i, column) in experiment.columns.iter().enumerate().filter(|(_, c)| c.main) {
        if let Some(chart) = plot::chart(&numbers, i) {
            let file = dir.join(format!("plot-{}.svg", plots.len() + 1));
            write_atomic(&file, |w| w.write_all(chart.as_file().as_bytes()))?;
            plots.push((column.label.clone(), chart.svg() + &chart.legend()));
        }
    }
    let quick = if args.quick { format!("{name} --quick") } else { name.clone() };
    let page = page::html(&quick, &numbers, &plots, &cells, &lines, &made)?;
    let json = numbers.json(&claims.iter().map(JudgedClaim::json).collect::<Vec<_>>());
    for (file, content) in [
        ("table.md", numbers.markdown(&lines, &quick, &made)),
        ("table.csv", numbers.csv()),
        ("table.json", serde_json::to_string_pretty(&json)?),
        ("index.html", page),
    ] {
        write_atomic(&dir.join(file), |w| w.write_all(content.as_bytes()))?;
    }
    let (ran, reused) = (runner.ran, runner.reused);
    let answer =
        serde_json::json!({ "experiment": name, "folder": shown(&dir), "ran": ran, "reused": reused, "numbers": json });
    context.answer(&answer, || {
        let mut text = format!("{}\n\n", experiment.title);
        for (i, column) in experiment.columns.iter().enumerate().filter(|(_, c)| c.main) {
            let (headings, rows) = numbers.pivot(i);
            text += &format!("{}\n{}\n", column.label, aligned(&headings, &rows));
        }
        for line in &lines {
            text += &format!("{line}\n");
        }
        for problem in numbers.problems() {
            text += &format!("without a result: {problem}\n");
        }
        let page = dir.join("index.html");
        text + &format!("{ran} commands run, {reused} taken from earlier runs\nopen  {}\n", page.display())
    })?;
    let broken = claims.iter().filter(|c| !c.against.is_empty()).count();
    if broken > 0 {
        anyhow::bail!(
            "{name}: {broken} of {} claims do not hold; see the lines that say so, and table.md in {}",
            claims.len(),
            shown(&dir)
        );
    }
    Ok(())
}

/// Lists the experiments that come with the program.
fn list(context: &CommandContext) -> Result<()> {
    let mut all = Vec::new();
    for (name, _) in BUILT_IN {
        let (_, experiment) = Experiment::read(name, false)?;
        all.push((name, experiment.title));
    }
    let json: Vec<_> = all.iter().map(|(name, title)| serde_json::json!({ "name": name, "title": title })).collect();
    context.answer(&json, || all.iter().map(|(name, title)| format!("{name:<10}  {title}\n")).collect())?;
    Ok(())
}

/// Returns when and where the tables were made, for their readers.
fn made() -> String {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let today = time::OffsetDateTime::now_utc().date();
    let (os, arch) = (std::env::consts::OS, std::env::consts::ARCH);
    format!("{today}, {os} {arch}, {cores} cores, nelu3d {}", env!("CARGO_PKG_VERSION"))
}

/// Returns a table for a terminal; the best of a row has a star.
fn aligned(headings: &[String], rows: &[Vec<TableCell>]) -> String {
    let text = |c: &TableCell| if c.best { format!("{} *", c.text) } else { c.text.clone() };
    let mut lines = vec![headings.to_vec()];
    lines.extend(rows.iter().map(|r| r.iter().map(text).collect()));
    let width = |c: usize| lines.iter().map(|l| l[c].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..headings.len()).map(width).collect();
    lines.iter().fold(String::new(), |out, line| {
        let cells: Vec<String> = line.iter().zip(&widths).map(|(s, w)| format!("{s:<w$}")).collect();
        out + cells.join("  ").trim_end() + "\n"
    })
}
