//! The files of a configuration that others on the machine must not read, or not change.

use std::path::Path;

use super::Config;

/// The bit of a mode that lets everybody write.
const EVERYBODY_WRITES: u32 = 0o002;

impl Config {
    /// The files with secrets, and what each is.
    fn secret_files(&self) -> Vec<(&Path, &'static str)> {
        let files = [
            (&self.http.token_file, "the file of the token"),
            (&self.http.tls_key, "the file of the key for TLS"),
            (&self.pacs.dimse.tls_key, "the file of the key for TLS"),
            (
                &self.storage.database_password_file,
                "the file of the database's password",
            ),
        ];
        let mut found: Vec<_> = (files.into_iter())
            .filter_map(|(file, what)| Some((file.as_deref()?, what)))
            .collect();
        for node in &self.pacs.nodes {
            let password = (&node.password_file, "the file of the password of a node");
            let token = (&node.token_file, "the file of the token of a node");
            for (file, what) in [password, token] {
                found.extend(file.as_deref().map(|file| (file, what)));
            }
        }
        found
    }

    /// Removes the permissions of others from the files with secrets, and logs that and what [`Config::risky_files`] finds. The long-running
    /// commands do this, because they have the user that the files are for; a command of root could lock that user out.
    pub(crate) fn keep_secrets(&self) {
        for (file, what) in self.secret_files() {
            storage::keep_private(file, what);
        }
        let credentials = std::env::var_os("AWS_SHARED_CREDENTIALS_FILE");
        if let (Some(file), Some(_)) = (credentials, &self.storage.objects) {
            storage::keep_private(Path::new(&file), "the file of the credentials");
        }
        for warning in self.risky_files() {
            tracing::warn!("{warning}");
        }
    }

    /// What others on the machine can read or change, in sentences; nothing is changed.
    pub(crate) fn open_files(&self) -> Vec<String> {
        let secrets = self.secret_files().into_iter();
        let readable = secrets.filter_map(|(file, what)| {
            let mode = storage::open_to_others(file)?;
            let file = file.display();
            Some(format!(
                "others on this machine can read {what}, {file}; its mode is {mode:04o}: let the user of the server alone read it"
            ))
        });
        readable.chain(self.risky_files()).collect()
    }

    /// The files and folders that say who may do what, whom to believe, and who did what.
    fn trusted_paths(&self) -> impl Iterator<Item = &Path> {
        let (http, dimse) = (&self.http, &self.pacs.dimse);
        let files = [
            &self.file,
            &http.tokens_file,
            &http.tls_certificate,
            &dimse.tls_certificate,
            &dimse.tls_authority,
            &self.audit.folder,
        ];
        let of_nodes = self.pacs.nodes.iter().map(|node| &node.tls_authority);
        let files = files.into_iter().chain(of_nodes);
        files.filter_map(Option::as_deref)
    }

    /// What the program does not mend itself: a configuration with a secret that others can read, and what everybody can change and should not.
    fn risky_files(&self) -> Vec<String> {
        let mut found = Vec::new();
        if let Some(file) = self.file.as_deref().filter(|_| self.http.token.is_some())
            && let Some(mode) = storage::open_to_others(file)
        {
            found.push(format!(
                "others on this machine can read the configuration {}, which has a token; its mode is {mode:04o}: \
                 write it into a file of its own (`http.token_file`)",
                file.display()
            ));
        }
        for path in self.trusted_paths() {
            if everybody_writes(path) {
                found.push(format!(
                    "everybody on this machine can change {}, on which the access to this server or its record depends: `chmod o-w` it",
                    path.display()
                ));
            }
        }
        found
    }
}

fn everybody_writes(file: &Path) -> bool {
    use std::os::unix::fs::PermissionsExt as _;
    let mode = std::fs::metadata(file).map(|metadata| metadata.permissions().mode());
    mode.is_ok_and(|mode| mode & EVERYBODY_WRITES != 0)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;
    use std::path::PathBuf;

    use super::*;
    use crate::config::Secret;

    fn file(folder: &Path, name: &str, mode: u32) -> PathBuf {
        let path = folder.join(name);
        std::fs::write(&path, "secret").unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
        path
    }

    fn mode(path: &Path) -> u32 {
        path.metadata().unwrap().permissions().mode() & 0o777
    }

    #[test]
    fn what_others_can_read_or_change_is_named_and_mended_by_the_server_alone() {
        let folder = tempfile::tempdir().unwrap();
        let mut config = Config::default();
        let token = file(folder.path(), "token", 0o644);
        config.http.token_file = Some(token.clone());
        config.http.tokens_file = Some(file(folder.path(), "tokens.toml", 0o646));
        config.audit.folder = Some(folder.path().to_owned());
        let found = config.open_files();
        let [readable, changed] = &found[..] else {
            panic!("{found:?}")
        };
        assert!(readable.contains("the file of the token, "), "{readable}");
        assert!(changed.contains("tokens.toml"), "{changed}");
        assert_eq!(mode(&token), 0o644, "it was looked at only");
        config.keep_secrets();
        assert_eq!(mode(&token), 0o600);
        assert_eq!(config.open_files().len(), 1);
    }

    #[test]
    fn a_configuration_with_a_secret_is_one() {
        let folder = tempfile::tempdir().unwrap();
        let mut config = Config {
            file: Some(file(folder.path(), "isocortex.toml", 0o644)),
            ..Config::default()
        };
        assert!(config.open_files().is_empty());
        config.http.token = Some(Secret("0123456789abcdef".to_owned()));
        let found = config.open_files().concat();
        assert!(found.contains("isocortex.toml"), "{found}");
    }
}
