//! `isocortex manual`.

use std::path::PathBuf;

use clap::{Args, CommandFactory as _};
use clap_complete::Shell;

use super::Cli;
use super::status::{CliError, ExitStatus};

/// Write the man pages and the completions of shells, for a package
#[derive(Debug, Clone, Args)]
pub(super) struct ManualArgs {
    /// The folder that becomes `/usr/share`, or `share` of another prefix.
    share: PathBuf,
}

/// Where packages install the completions of a shell, below `share`.
const COMPLETIONS: [(Shell, &str, &str); 3] = [
    (Shell::Bash, "bash-completion/completions", "isocortex"),
    (Shell::Zsh, "zsh/site-functions", "_isocortex"),
    (Shell::Fish, "fish/vendor_completions.d", "isocortex.fish"),
];

/// Writes all files.
pub(super) fn run(args: &ManualArgs) -> Result<(), CliError> {
    let failed = |error| {
        let message = format!("{} cannot be written: {error}", args.share.display());
        CliError::new(ExitStatus::CannotCreate, message)
    };
    write(args).map_err(failed)
}

fn write(args: &ManualArgs) -> std::io::Result<()> {
    let pages = args.share.join("man/man1");
    std::fs::create_dir_all(&pages)?;
    clap_mangen::generate_to(Cli::command(), pages)?;
    for (shell, folder, file) in COMPLETIONS {
        let folder = args.share.join(folder);
        std::fs::create_dir_all(&folder)?;
        let mut script = Vec::new();
        clap_complete::generate(shell, &mut Cli::command(), "isocortex", &mut script);
        std::fs::write(folder.join(file), script)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_command_has_a_page_and_each_shell_its_completions() {
        let folder = tempfile::tempdir().unwrap();
        let share = folder.path().to_owned();
        run(&ManualArgs { share }).unwrap();
        let text = |file: &str| std::fs::read_to_string(folder.path().join(file)).unwrap();
        assert!(text("man/man1/isocortex.1").contains("isocortex\\-serve(1)"));
        assert!(text("man/man1/isocortex-serve.1").contains("ISOCORTEX_LISTEN"));
        for (_, folder, file) in COMPLETIONS {
            assert!(text(&format!("{folder}/{file}")).contains("check-config"));
        }
    }
}
