//! `isocortex test-node`.

use clap::Args;
use pacs::test_in_words;

use super::serve::ServeArgs;
use super::status::{CliError, ExitStatus};

/// Ask a node of the PACS whether it answers
///
/// Asks its DICOMweb server for one study (QIDO-RS), and its storage SCP for an echo (C-ECHO), with the names, passwords
/// and certificates of the configuration. Nothing is stored there. The exit status is 0 if all services answered, and 69
/// if one did not.
#[derive(Debug, Clone, Args)]
pub(super) struct TestNodeArgs {
    #[command(flatten)]
    serve: ServeArgs,
    /// The name of the node in `pacs.nodes`; without it, all nodes.
    #[arg(value_name = "NODE")]
    node: Option<String>,
}

/// Tests one node or all, and prints a line for each service.
pub(super) fn run(args: &TestNodeArgs) -> Result<(), CliError> {
    let mut nodes = args.serve.config()?.pacs.nodes()?;
    nodes.retain(|node| args.node.as_deref().is_none_or(|name| name == node.name()));
    if nodes.is_empty() {
        let message = "no node of the configuration has this name; list it in `pacs.nodes`";
        return Err(CliError::new(ExitStatus::Usage, message));
    }
    super::block_on(async {
        let mut are_reachable = true;
        for node in &nodes {
            let (lines, is_reachable) = test_in_words(node).await;
            for line in lines {
                println!("{line}");
            }
            are_reachable &= is_reachable;
        }
        match are_reachable {
            true => Ok(()),
            false => Err(CliError::new(
                ExitStatus::Unavailable,
                "a node did not answer as it must",
            )),
        }
    })
}
