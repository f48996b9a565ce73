//! Whether the commands of an experiment can be typed: a wrong option is found before anything is computed.

use anyhow::{Result, bail};
use clap::Parser;

use super::file::{Experiment, Method};
use super::placeholders::Placeholders;
use crate::args::Args;

/// Checks the options of every method, with the values that stand for their placeholders.
///
/// # Errors
///
/// A command has an option, or a value of one, that it does not know.
pub(super) fn check(experiment: &Experiment) -> Result<()> {
    let n_values = experiment.vary.as_ref().map_or(1, |v| v.values.len());
    for case in &experiment.cases {
        for value in 0..n_values {
            let placeholders = Placeholders { experiment, case, value, seed: experiment.seeds[0] };
            for method in &experiment.methods {
                for (key, words) in commands(method, &placeholders) {
                    if let Err(e) = Args::try_parse_from(&words) {
                        bail!("method `{}`: {}; correct its `{key}`", method.label, reason(&e));
                    }
                }
            }
        }
    }
    Ok(())
}

/// Returns the commands of a method, each with the key of the file that its options are from.
fn commands(method: &Method, placeholders: &Placeholders<'_>) -> Vec<(&'static str, Vec<String>)> {
    let command = |first: &[&str], options: &str| {
        let mut words: Vec<String> = ["nelu3d"].iter().chain(first).map(|word| (*word).to_owned()).collect();
        words.extend(placeholders.words(options));
        words
    };
    let (name, options) = method.run.trim().split_once(char::is_whitespace).unwrap_or((method.run.trim(), ""));
    let mut all = vec![
        ("run", command(&[name, "rig", "scene"], options)),
        ("calibrate", command(&["calibrate", "rig"], &method.calibrate)),
    ];
    all.extend(method.projector.as_deref().map(|options| ("projector", command(&["projector", "rig"], options))));
    all
}

/// Returns what is wrong with a command, in a line.
fn reason(e: &clap::Error) -> String {
    let text = e.to_string();
    let lines: Vec<&str> = text.lines().map(str::trim).take_while(|line| !line.is_empty()).collect();
    lines.join(" ").trim_start_matches("error: ").to_owned()
}

#[cfg(test)]
mod tests {
    use super::super::file::BUILT_IN;
    use super::*;

    #[test]
    fn commands_of_the_built_in_experiments_can_be_typed() {
        for (name, _) in BUILT_IN {
            for quick in [false, true] {
                let (_, experiment) = Experiment::read(name, quick).unwrap();
                check(&experiment).unwrap_or_else(|e| panic!("{name}: {e}"));
            }
        }
    }

    #[test]
    fn a_wrong_option_is_named() {
        let (_, mut experiment) = Experiment::read("stage", true).unwrap();
        for (wrong, key) in [("--effort hasty", "run"), ("--efort best", "run"), ("--cells many", "calibrate")] {
            let method = &mut experiment.methods[0];
            method.run = if key == "run" { format!("reconstruct {wrong}") } else { "reconstruct".into() };
            method.calibrate = if key == "run" { String::new() } else { wrong.into() };
            let said = check(&experiment).unwrap_err().to_string();
            let option = wrong.split(' ').next().unwrap();
            assert!(said.contains(option) && said.contains(&format!("correct its `{key}`")), "{said}");
            assert!(said.lines().count() == 1 && said.contains("method `"), "{said}");
        }
    }
}
