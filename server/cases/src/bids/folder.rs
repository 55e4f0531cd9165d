//! The heads of a BIDS folder: each T1-weighted volume, and the FLAIR beside it.

use std::collections::BTreeSet;
use std::fs::Metadata;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use serde_json::Value;

/// The endings of a NIfTI file.
const NIFTI: [&str; 2] = [".nii.gz", ".nii"];

/// The longest JSON file that is read, in bytes.
const MAX_JSON_BYTES: u64 = 4 << 20;

/// Entities that a volume as it was acquired does not have, and files derived from it do.
const OF_DERIVATIVES: [&str; 2] = ["desc-", "space-"];

/// Why a folder cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// It, or a folder in it, cannot be listed.
    #[error("{} cannot be listed: {source}", .path.display())]
    Unreadable {
        path: PathBuf,
        source: std::io::Error,
    },
    /// Its description is missing or wrong.
    #[error("{} is no BIDS folder: {why}; mend it, or add --skip-bids-validation", .path.display())]
    NotBids { path: PathBuf, why: String },
    /// There is nothing in it.
    #[error("{} has no folder sub-*: it is not a BIDS folder", .path.display())]
    NoSubjects { path: PathBuf },
    /// A label that was asked for is not there.
    #[error("there is no {what}-{label} in the folder; it has {}", shortened(.known))]
    NoSuchLabel {
        what: &'static str,
        label: String,
        known: Vec<String>,
    },
}

/// The first of some labels.
fn shortened(known: &[String]) -> String {
    const MOST: usize = 8;
    match known.len() {
        0 => "none".to_owned(),
        count if count > MOST => {
            format!("{} and {} others", known[..MOST].join(", "), count - MOST)
        }
        _ => known.join(", "),
    }
}

/// The name of a head, which begins those of its files.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct HeadName {
    /// `sub-01`, or `sub-01/ses-a`.
    pub folder: PathBuf,
    /// `sub-01_ses-a_run-1`: that of its T1-weighted volume without the suffix.
    pub prefix: String,
}

/// The volumes of a head.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HeadFiles {
    pub t1w: PathBuf,
    /// The FLAIR beside it.
    pub flair: Option<PathBuf>,
}

/// A head of a folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Found {
    pub name: HeadName,
    /// Its volumes, or why it cannot be used.
    pub files: Result<HeadFiles, String>,
    /// What is wrong with what is beside it, in sentences.
    pub notes: Vec<String>,
}

/// The heads of a BIDS folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Folder {
    pub root: PathBuf,
    /// Those that are meant, in the order of their names.
    pub heads: Vec<Found>,
    /// All others.
    pub others: Vec<Found>,
}

/// Which heads are meant. An empty list is all of them.
#[derive(Debug, Clone, Copy)]
pub struct Labels<'a> {
    /// With or without `sub-`.
    pub participants: &'a [String],
    /// With or without `ses-`.
    pub sessions: &'a [String],
}

impl Folder {
    /// Finds the heads with these labels. Links are followed, because DataLad and git-annex keep volumes elsewhere.
    ///
    /// # Errors
    /// If the folder cannot be listed, has no subjects, or lacks a label. With `validates`, if its description is not that of a BIDS data set.
    pub fn read(root: &Path, labels: Labels<'_>, validates: bool) -> Result<Self, FolderError> {
        let entries = listed(root)?;
        if validates {
            check_description(root).map_err(|why| FolderError::NotBids {
                path: root.to_owned(),
                why,
            })?;
        }
        let subjects: Vec<_> = folders(&entries, "sub-").collect();
        if subjects.is_empty() {
            return Err(FolderError::NoSubjects {
                path: root.to_owned(),
            });
        }
        let wanted = chosen("sub", &subjects, labels.participants)?;
        let (heads, sessions) = heads_of(root, &wanted, labels.sessions);
        for label in labels.sessions {
            let name = with_prefix("ses", label);
            if !sessions.contains(&name) {
                return Err(no_such("ses", label, &sessions));
            }
        }
        let is_other = |found: &Found| heads.iter().all(|head| head.name != found.name);
        let others = if labels.participants.is_empty() && labels.sessions.is_empty() {
            Vec::new()
        } else {
            let (all, _) = heads_of(root, &subjects, &[]);
            all.into_iter().filter(is_other).collect()
        };
        Ok(Self {
            root: root.to_owned(),
            heads,
            others,
        })
    }
}

/// The heads of some subjects in the sessions that are meant, and the names of all their sessions.
fn heads_of(root: &Path, subjects: &[&str], labels: &[String]) -> (Vec<Found>, Vec<String>) {
    let (mut heads, mut sessions) = (Vec::new(), BTreeSet::new());
    for subject in subjects {
        add_subject(root, subject, labels, (&mut heads, &mut sessions));
    }
    heads.sort_by(|a: &Found, b| a.name.cmp(&b.name));
    (heads, sessions.into_iter().collect())
}

fn no_such(what: &'static str, label: &str, known: &[String]) -> FolderError {
    FolderError::NoSuchLabel {
        what,
        label: bare(what, label).to_owned(),
        known: known.to_vec(),
    }
}

/// A label without `sub-` or `ses-`.
fn bare<'a>(what: &str, label: &'a str) -> &'a str {
    let rest = label.strip_prefix(what);
    rest.and_then(|rest| rest.strip_prefix('-'))
        .unwrap_or(label)
}

fn with_prefix(what: &str, label: &str) -> String {
    format!("{what}-{}", bare(what, label))
}

/// Those of some folders that have the labels; all without labels.
fn chosen<'a>(
    what: &'static str,
    folders: &[&'a str],
    labels: &[String],
) -> Result<Vec<&'a str>, FolderError> {
    if labels.is_empty() {
        return Ok(folders.to_vec());
    }
    let find = |label: &String| {
        let name = with_prefix(what, label);
        let found = folders.iter().find(|folder| **folder == name);
        found.copied().ok_or_else(|| {
            let known: Vec<_> = folders.iter().map(|&folder| folder.to_owned()).collect();
            no_such(what, label, &known)
        })
    };
    let mut found = labels.iter().map(find).collect::<Result<Vec<_>, _>>()?;
    found.sort_unstable();
    found.dedup();
    Ok(found)
}

/// An entry of a folder, and what it leads to if it is a link.
struct Entry {
    /// `None` if it is not UTF-8.
    name: Option<String>,
    path: PathBuf,
    metadata: std::io::Result<Metadata>,
}

impl Entry {
    /// Whether it is a folder, or a link that leads nowhere and has the name of one.
    fn is_folder(&self) -> bool {
        match &self.metadata {
            Ok(metadata) => metadata.is_dir(),
            Err(_) => self.path.extension().is_none(),
        }
    }
}

/// The entries of a folder in the order of their names, without hidden ones.
fn listed(folder: &Path) -> Result<Vec<Entry>, FolderError> {
    let unreadable = |source| FolderError::Unreadable {
        path: folder.to_owned(),
        source,
    };
    let mut entries = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let name = path.file_name().and_then(|name| name.to_str());
        if name.is_some_and(|name| name.starts_with('.')) {
            continue;
        }
        entries.push(Entry {
            name: name.map(str::to_owned),
            metadata: std::fs::metadata(&path),
            path,
        });
    }
    entries.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(entries)
}

/// The names of the folders that begin so.
fn folders<'a>(entries: &'a [Entry], start: &'a str) -> impl Iterator<Item = &'a str> {
    let folders = entries.iter().filter(|entry| entry.is_folder());
    let names = folders.filter_map(|entry| entry.name.as_deref());
    names.filter(move |name| name.starts_with(start))
}

/// What is wrong with the description of a folder.
fn check_description(root: &Path) -> Result<(), String> {
    const NAME: &str = "dataset_description.json";
    let described = match read_json(&root.join(NAME)) {
        Ok(Some(described)) => described,
        Ok(None) => return Err(format!("it has no {NAME}")),
        Err(why) => return Err(format!("its {NAME} {why}")),
    };
    for key in ["Name", "BIDSVersion"] {
        if !described.get(key).is_some_and(Value::is_string) {
            return Err(format!("its {NAME} has no `{key}`"));
        }
    }
    match described.get("DatasetType").and_then(Value::as_str) {
        None | Some("raw") => Ok(()),
        Some(other) => Err(format!("its {NAME} says that it is `{other}`, not `raw`")),
    }
}

/// The object in a JSON file; `None` if there is no file. Otherwise what is wrong with it.
fn read_json(path: &Path) -> Result<Option<Value>, String> {
    let metadata = match std::fs::metadata(path) {
        Ok(metadata) => metadata,
        Err(error) if error.kind() == ErrorKind::NotFound && path.symlink_metadata().is_err() => {
            return Ok(None);
        }
        Err(error) => return Err(format!("cannot be read: {error}")),
    };
    if !metadata.is_file() || metadata.len() > MAX_JSON_BYTES {
        return Err("is no file, or too long".to_owned());
    }
    let bytes = std::fs::read(path).map_err(|error| format!("cannot be read: {error}"))?;
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
    match serde_json::from_slice::<Value>(text) {
        Ok(object) if object.is_object() => Ok(Some(object)),
        Ok(_) => Err("is no JSON object".to_owned()),
        Err(error) => Err(format!("is no JSON: {error}")),
    }
}

/// Adds the heads of a subject in the sessions that are meant, and the names of all its sessions.
fn add_subject(
    root: &Path,
    subject: &str,
    labels: &[String],
    (heads, all_sessions): (&mut Vec<Found>, &mut BTreeSet<String>),
) {
    let entries = match listed(&root.join(subject)) {
        Ok(entries) => entries,
        Err(error) => return heads.push(Found::unlisted(Path::new(subject), &error)),
    };
    let sessions: Vec<_> = folders(&entries, "ses-").collect();
    all_sessions.extend(sessions.iter().map(|&session| session.to_owned()));
    let is_meant = |session: &&&str| {
        labels.is_empty()
            || labels
                .iter()
                .any(|label| with_prefix("ses", label) == **session)
    };
    let mut scanned: Vec<PathBuf> = sessions
        .iter()
        .filter(is_meant)
        .map(|session| Path::new(subject).join(session))
        .collect();
    if labels.is_empty() {
        scanned.insert(0, PathBuf::from(subject));
    }
    let before = heads.len();
    for folder in &scanned {
        add_heads(root, folder, heads);
    }
    if heads.len() == before && !scanned.is_empty() {
        heads.push(Found {
            name: HeadName {
                folder: PathBuf::from(subject),
                prefix: subject.to_owned(),
            },
            files: Err(
                "it has no T1-weighted volume: no file anat/*_T1w.nii.gz or .nii".to_owned(),
            ),
            notes: Vec::new(),
        });
    }
}

impl Found {
    /// What is in the folder of a subject or of a session that cannot be listed.
    fn unlisted(folder: &Path, error: &FolderError) -> Self {
        let hint = match error {
            FolderError::Unreadable { source, .. } if source.kind() == ErrorKind::NotFound => {
                "; it is a link to a folder that is missing"
            }
            _ => "",
        };
        Self {
            name: HeadName {
                folder: folder.to_owned(),
                prefix: prefix_of(folder),
            },
            files: Err(format!("{error}{hint}")),
            notes: Vec::new(),
        }
    }
}

/// How the names of the files in the folder of a subject or of a session begin.
fn prefix_of(folder: &Path) -> String {
    folder.to_string_lossy().replace('/', "_")
}

/// Adds the heads of the folder of a subject or of a session.
fn add_heads(root: &Path, folder: &Path, heads: &mut Vec<Found>) {
    let path = root.join(folder);
    let anat = path.join("anat");
    let is_absent = |path: &Path| {
        let found = path.symlink_metadata();
        found.is_err_and(|error| error.kind() == ErrorKind::NotFound)
    };
    if path.is_dir() && is_absent(&anat) {
        return;
    }
    let entries = match listed(&anat) {
        Ok(entries) => entries,
        Err(error) => return heads.push(Found::unlisted(folder, &error)),
    };
    let of = |suffix: &'static str| {
        let is_one = move |entry: &&Entry| stem_of(&lossy(entry), suffix).is_some();
        entries.iter().filter(is_one)
    };
    let flairs: Vec<_> = of("_FLAIR").collect();
    let start = prefix_of(folder);
    for entry in of("_T1w") {
        let name = lossy(entry);
        let prefix = stem_of(&name, "_T1w").unwrap_or_default().to_owned();
        let is_twice = of("_T1w").any(|other| {
            other.path != entry.path && stem_of(&lossy(other), "_T1w") == Some(&prefix)
        });
        if is_twice && name.ends_with(".nii") {
            // One row for both.
            continue;
        }
        let mut notes = Vec::new();
        let unusable = if entry.name.is_none() {
            Some(format!("the name {name} is not UTF-8"))
        } else if is_twice {
            Some("it is there twice, as .nii and as .nii.gz: remove one of them".to_owned())
        } else if prefix != start && !prefix.starts_with(&format!("{start}_")) {
            Some(format!("the name {name} does not begin with {start}_"))
        } else if let Some(entity) = OF_DERIVATIVES
            .iter()
            .find(|one| prefix.contains(&format!("_{one}")))
        {
            Some(format!(
                "the name {name} has the entity {entity}, which is that of a derivative, not of an acquired volume"
            ))
        } else {
            unreadable(entry)
        };
        let files = match unusable {
            Some(why) => Err(why),
            None => Ok(HeadFiles {
                flair: flair_beside(&prefix, &flairs, &mut notes),
                t1w: entry.path.clone(),
            }),
        };
        if let Err(why) = read_json(&anat.join(format!("{prefix}_T1w.json"))) {
            notes.push(format!("{prefix}_T1w.json {why}; it was ignored"));
        }
        heads.push(Found {
            name: HeadName {
                folder: folder.to_owned(),
                prefix,
            },
            files,
            notes,
        });
    }
}

fn lossy(entry: &Entry) -> String {
    let name = entry.path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// The name of a NIfTI file without its suffix and ending; `None` if it has another suffix.
fn stem_of<'a>(name: &'a str, suffix: &str) -> Option<&'a str> {
    let stem = NIFTI.iter().find_map(|ending| name.strip_suffix(ending))?;
    stem.strip_suffix(suffix)
}

/// Why the file of an entry cannot be read.
fn unreadable(entry: &Entry) -> Option<String> {
    match &entry.metadata {
        Ok(metadata) if metadata.is_file() => None,
        Ok(_) => Some(format!("{} is no file", lossy(entry))),
        Err(error) if error.kind() == ErrorKind::NotFound => Some(format!(
            "{} is a link to a file that is missing; fetch it first (`datalad get`, `git annex get`)",
            lossy(entry)
        )),
        Err(error) => Some(format!("{} cannot be read: {error}", lossy(entry))),
    }
}

/// The FLAIR in the folder of a T1-weighted volume. Of several, the one with the most similar name counts, and of equally similar ones the
/// first.
fn flair_beside(prefix: &str, flairs: &[&Entry], notes: &mut Vec<String>) -> Option<PathBuf> {
    let in_common = |entry: &&&Entry| {
        let name = lossy(entry);
        let stem = stem_of(&name, "_FLAIR").unwrap_or_default().to_owned();
        let known: BTreeSet<_> = prefix.split('_').collect();
        stem.split('_')
            .filter(|entity| known.contains(entity))
            .count()
    };
    // Of equals, the last of an iterator is the greatest.
    let chosen = flairs.iter().rev().max_by_key(in_common)?;
    if flairs.len() > 1 {
        notes.push(format!(
            "of {} FLAIRs, {} is used",
            flairs.len(),
            lossy(chosen)
        ));
    }
    if let Some(why) = unreadable(chosen) {
        notes.push(format!("no FLAIR is used: {why}"));
        return None;
    }
    Some(chosen.path.clone())
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    struct Made(tempfile::TempDir);

    impl Made {
        fn new(files: &[&str]) -> Self {
            let made = Self(tempfile::tempdir().unwrap());
            for file in files {
                made.write(file, b"{}");
            }
            made
        }

        fn path(&self, file: &str) -> PathBuf {
            self.0.path().join(file)
        }

        fn write(&self, file: &str, bytes: &[u8]) {
            std::fs::create_dir_all(self.path(file).parent().unwrap()).unwrap();
            std::fs::write(self.path(file), bytes).unwrap();
        }

        fn read(&self, participants: &[&str], sessions: &[&str]) -> Result<Folder, FolderError> {
            let owned =
                |labels: &[&str]| labels.iter().map(|&one| one.to_owned()).collect::<Vec<_>>();
            let labels = Labels {
                participants: &owned(participants),
                sessions: &owned(sessions),
            };
            Folder::read(self.0.path(), labels, false)
        }
    }

    fn prefixes(folder: &Folder) -> Vec<&str> {
        folder.heads.iter().map(|head| &*head.name.prefix).collect()
    }

    #[test]
    fn each_t1_is_a_head_with_the_flair_that_is_most_like_it() {
        let made = Made::new(&[
            "sub-02/ses-b/anat/sub-02_ses-b_T1w.nii.gz",
            "sub-02/ses-a/anat/sub-02_ses-a_run-1_T1w.nii",
            "sub-02/ses-a/anat/sub-02_ses-a_run-2_T1w.nii.gz",
            "sub-02/ses-a/anat/sub-02_ses-a_run-2_FLAIR.nii.gz",
            "sub-02/ses-a/anat/sub-02_ses-a_acq-x_FLAIR.nii.gz",
            "sub-02/ses-a/anat/sub-02_ses-a_T1w_roi.nii.gz",
            "sub-03/func/sub-03_bold.nii.gz",
            "sub-0 1/anat/sub-0 1_T1w.nii.gz",
            "derivatives/x/sub-02/anat/sub-02_T1w.nii.gz",
        ]);
        let found = made.read(&[], &[]).unwrap();
        let names = [
            "sub-0 1",
            "sub-02_ses-a_run-1",
            "sub-02_ses-a_run-2",
            "sub-02_ses-b",
            "sub-03",
        ];
        assert_eq!(prefixes(&found), names);
        let flairs = found.heads.iter().map(|head| {
            let flair = head.files.as_ref().ok()?.flair.as_ref()?;
            Some(flair.file_name()?.to_str()?.to_owned())
        });
        let flairs: Vec<_> = flairs.collect();
        assert_eq!(
            flairs[1].as_deref(),
            Some("sub-02_ses-a_acq-x_FLAIR.nii.gz")
        );
        assert_eq!(
            flairs[2].as_deref(),
            Some("sub-02_ses-a_run-2_FLAIR.nii.gz")
        );
        assert_eq!([&flairs[0], &flairs[3]], [&None, &None]);
        assert!(found.heads[1].notes[0].starts_with("of 2 FLAIRs"));
        assert!(
            found.heads[4]
                .files
                .as_ref()
                .unwrap_err()
                .contains("no T1-weighted")
        );
        assert_eq!(found.heads[3].name.folder, Path::new("sub-02/ses-b"));

        assert!(found.others.is_empty());
        let found = made.read(&["sub-02"], &["b"]).unwrap();
        assert_eq!(prefixes(&found), ["sub-02_ses-b"]);
        let others = found.others.iter().map(|head| &*head.name.prefix);
        let names = [
            "sub-0 1",
            "sub-02_ses-a_run-1",
            "sub-02_ses-a_run-2",
            "sub-03",
        ];
        assert_eq!(others.collect::<Vec<_>>(), names);
        assert_eq!(
            prefixes(&made.read(&["0 1", "sub-03"], &[]).unwrap()),
            ["sub-0 1", "sub-03"]
        );
        let error = made.read(&["9"], &[]).unwrap_err().to_string();
        assert_eq!(
            error,
            "there is no sub-9 in the folder; it has sub-0 1, sub-02, sub-03"
        );
        let error = made.read(&[], &["c"]).unwrap_err().to_string();
        assert_eq!(
            error,
            "there is no ses-c in the folder; it has ses-a, ses-b"
        );
    }

    #[test]
    fn what_cannot_be_used_has_a_row_with_its_reason() {
        let made = Made::new(&[
            "sub-1/anat/sub-1_T1w.nii",
            "sub-1/anat/sub-1_T1w.nii.gz",
            "sub-2/anat/scan_T1w.nii.gz",
            "sub-3/anat/sub-3_space-MNI_desc-preproc_T1w.nii.gz",
            "elsewhere/kept.nii.gz",
        ]);
        std::fs::create_dir_all(made.path("sub-4/anat/sub-4_T1w.nii.gz")).unwrap();
        std::fs::create_dir_all(made.path("sub-5/anat")).unwrap();
        symlink("nowhere", made.path("sub-5/anat/sub-5_T1w.nii.gz")).unwrap();
        std::fs::create_dir_all(made.path("sub-6/anat")).unwrap();
        symlink(
            "../../elsewhere/kept.nii.gz",
            made.path("sub-6/anat/sub-6_T1w.nii.gz"),
        )
        .unwrap();
        symlink("nowhere", made.path("sub-6/anat/sub-6_FLAIR.nii.gz")).unwrap();
        std::fs::create_dir_all(made.path("sub-7/ses-a")).unwrap();
        symlink("nowhere", made.path("sub-7/ses-a/anat")).unwrap();
        symlink("nowhere", made.path("sub-7/ses-b")).unwrap();
        made.write("sub-8/anat", b"");
        symlink("nowhere", made.path("sub-9")).unwrap();
        made.write("sub-6/anat/sub-6_T1w.json", b"{\"a\": ");
        let found = made.read(&[], &[]).unwrap();
        let words = [
            "there twice",
            "does not begin with sub-2_",
            "entity desc-",
            "is no file",
            "datalad get",
            "",
            "missing",
            "missing",
            "cannot be listed",
            "missing",
        ];
        let names = ["sub-7_ses-a", "sub-7_ses-b", "sub-8", "sub-9"];
        assert_eq!(prefixes(&found)[6..], names, "{found:?}");
        for (head, words) in found.heads.iter().zip(words) {
            if words.is_empty() {
                continue;
            }
            assert!(head.files.as_ref().unwrap_err().contains(words), "{head:?}");
        }
        // A link that leads outward is followed.
        let last = &found.heads[5];
        assert!(last.files.as_ref().is_ok_and(|files| files.flair.is_none()));
        assert!(last.notes[0].contains("no FLAIR is used") && last.notes[1].contains("is no JSON"));
    }

    #[test]
    fn a_folder_is_described_unless_nobody_looks() {
        let made = Made::new(&["sub-1/anat/sub-1_T1w.nii"]);
        let all = Labels {
            participants: &[],
            sessions: &[],
        };
        let check = || Folder::read(made.0.path(), all, true).map_err(|error| error.to_string());
        assert!(
            check()
                .unwrap_err()
                .contains("has no dataset_description.json")
        );
        for (text, words) in [
            ("{", "is no JSON"),
            ("[]", "is no JSON object"),
            (r#"{"Name": "a"}"#, "has no `BIDSVersion`"),
            (
                r#"{"Name": "a", "BIDSVersion": "1.9.0", "DatasetType": "derivative"}"#,
                "`derivative`, not `raw`",
            ),
        ] {
            made.write("dataset_description.json", text.as_bytes());
            assert!(check().unwrap_err().contains(words), "{text}");
        }
        made.write(
            "dataset_description.json",
            br#"{"Name": "a", "BIDSVersion": "1.9.0"}"#,
        );
        assert!(check().is_ok());
        let empty = tempfile::tempdir().unwrap();
        assert!(matches!(
            Folder::read(empty.path(), all, false),
            Err(FolderError::NoSubjects { .. })
        ));
    }
}
