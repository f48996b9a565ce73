//! `nelu3d manual`: what packages of the program carry along, manual pages and completions for shells.

use anyhow::{Context as _, Result};
use clap::CommandFactory as _;
use clap_complete::{Shell, generate};
use nelu3d_scan::output::{create_dir, write_atomic};

use crate::args::{Args, ManualArgs};
use crate::context::CommandContext;
use crate::paths::shown;

/// Runs the command.
pub(crate) fn run(args: ManualArgs, context: &CommandContext) -> Result<()> {
    let mut program = Args::command();
    let pages = args.output.join("man1");
    create_dir(&pages)?;
    // One page a command, named as git's are: nelu3d-board-charuco.1.
    clap_mangen::generate_to(program.clone(), &pages)
        .with_context(|| format!("{}: cannot be written", shown(&pages)))?;
    let completions = args.output.join("completions");
    create_dir(&completions)?;
    for shell in [Shell::Bash, Shell::Zsh, Shell::Fish, Shell::PowerShell] {
        let name = match shell {
            Shell::Bash => "nelu3d.bash",
            Shell::Zsh => "_nelu3d",
            Shell::Fish => "nelu3d.fish",
            _ => "_nelu3d.ps1",
        };
        let mut text = Vec::new();
        generate(shell, &mut program, "nelu3d", &mut text);
        let path = completions.join(name);
        write_atomic(&path, |w| w.write_all(&text))?;
    }
    let answer = serde_json::json!({ "manual": shown(&pages), "completions": shown(&completions) });
    context.answer(&answer, || format!("manual       {}\ncompletions  {}", shown(&pages), shown(&completions)))?;
    Ok(())
}
