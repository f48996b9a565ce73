//! The job array that computes a sequence on a cluster. Slurm schedules; every task is the command itself with a part
//! of the frames.

use std::ffi::OsString;
use std::path::Path;

use anyhow::{Context as _, Result};
use nelu3d::sequence::Plan;
use nelu3d_scan::output::write_atomic;

use crate::args::SequenceArgs;
use crate::context::CommandContext;
use crate::paths::shown;

/// Writes the script.
pub(super) fn write(
    script: &Path,
    args: &SequenceArgs,
    output: &Path,
    frames: usize,
    context: &CommandContext,
) -> Result<()> {
    let plan = Plan { frames, keyframe: args.keyframe.get() };
    let tasks = args.tasks.map_or(plan.stretches(), |n| n.get().min(plan.stretches())).max(1);
    let command = command(args, output, context)?;
    let text = text(&command, tasks, frames, plan);
    write_atomic(script, |w| w.write_all(text.as_bytes()))?;
    context.answer(&serde_json::json!({ "script": shown(script), "tasks": tasks, "frames": frames }), || {
        format!(
            "script  {}\n{tasks} tasks for {frames} frames; submit them with: sbatch {}",
            shown(script),
            shown(script)
        )
    })?;
    Ok(())
}

/// Returns the command of one task, without its part: what was typed, with paths that hold on every machine that sees
/// the same disk.
fn command(args: &SequenceArgs, output: &Path, context: &CommandContext) -> Result<String> {
    let here = std::env::current_dir().context("cannot tell the current folder")?;
    let full = |path: &Path| Ok::<_, anyhow::Error>(quoted(&in_script(here.join(path).into_os_string())?));
    let text = |words: Vec<OsString>| words.into_iter().map(in_script).collect::<Result<Vec<String>>>();
    let mut words: Vec<String> = text(context.program.command()?)?.iter().map(|word| quoted(word)).collect();
    let mut typed = text(context.typed.clone())?.into_iter();
    // Only what says where something is or what this script is changes; all settings go on as they were typed.
    while let Some(word) = typed.next() {
        let (name, value) = match word.split_once('=') {
            Some((name, value)) if name.starts_with("--") => (name.to_owned(), Some(value.to_owned())),
            _ => (word.clone(), None),
        };
        match name.as_str() {
            "--slurm" | "--tasks" | "--threads" | "-o" | "--output" | "--field" => {
                let value = value.or_else(|| typed.next());
                if let ("--field", Some(value)) = (name.as_str(), value) {
                    words.extend(["--field".into(), full(Path::new(&value))?]);
                }
            }
            "--json" | "--quiet" | "-q" => {}
            short if short.starts_with("-o") => {}
            _ if Path::new(&word) == args.rig => words.push(full(&args.rig)?),
            _ if word == args.sequence && Path::new(&word).components().count() > 1 => {
                words.push(full(Path::new(&word))?)
            }
            _ => words.push(quoted(&word)),
        }
    }
    words.extend(["--output".into(), full(output)?]);
    Ok(words.join(" "))
}

/// Returns a word of a command line as the text that a script can hold.
fn in_script(word: OsString) -> Result<String> {
    word.into_string().map_err(|word| {
        let word = word.to_string_lossy().into_owned();
        anyhow::anyhow!("{word}: is no UTF-8, which a script must be; rename the file or folder, or link to it")
    })
}

/// Returns the script.
fn text(command: &str, tasks: usize, frames: usize, plan: Plan) -> String {
    format!(
        "#!/bin/sh\n\
         # {frames} frames, a keyframe every {}: {} stretches that do not need each other, in {tasks} tasks.\n\
         # Fewer frames between keyframes (--keyframe) allow more tasks; more make a frame cheaper. Submit again after a\n\
         # failure: finished frames are not computed twice. The task that finishes last writes the moving surface.\n\
         #SBATCH --job-name=nelu3d\n\
         #SBATCH --array=1-{tasks}\n\
         #SBATCH --ntasks=1\n\
         #SBATCH --output=nelu3d-%A_%a.log\n\
         exec {command} --quiet --threads \"${{SLURM_CPUS_PER_TASK:-1}}\" --shard \"${{SLURM_ARRAY_TASK_ID}}/{tasks}\"\n",
        plan.keyframe,
        plan.stretches(),
    )
}

/// Quotes a word so that the shell reads it back.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:+".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_survive_the_shell() {
        for word in ["plain", "two words", "it's", "", "$HOME", "a;b"] {
            let out =
                std::process::Command::new("sh").arg("-c").arg(format!("printf %s {}", quoted(word))).output().unwrap();
            assert_eq!(String::from_utf8(out.stdout).unwrap(), word);
        }
    }

    #[test]
    fn the_script_names_every_part() {
        let script = text("nelu3d sequence rig bunny", 4, 60, Plan { frames: 60, keyframe: 15 });
        assert!(
            script.contains("--array=1-4\n") && script.contains("--shard \"${SLURM_ARRAY_TASK_ID}/4\"\n"),
            "{script}"
        );
    }
}
