//! The files of a BIDS folder: the T1-weighted volume of each head, its FLAIR, and the truths.

use std::path::{Path, PathBuf};

use crate::BenchError;

/// The endings of a NIfTI file.
const NIFTI: [&str; 2] = [".nii.gz", ".nii"];

/// Where truths are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Truths {
    /// The folder that the pattern is relative to; `None` for the folder of each head.
    pub folder: Option<PathBuf>,
    /// Parts between slashes, in which `*` is any text, `{id}` the name of the head without `sub-`, and `{n}` the same without leading
    /// zeros.
    pub pattern: String,
}

/// A head of the folder, with its files in the order of their names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct HeadFiles {
    /// `sub-01`.
    pub(super) name: String,
    /// Each T1-weighted volume; the first is used.
    pub(super) t1: Vec<PathBuf>,
    /// The FLAIRs; the first is used.
    pub(super) flair: Vec<PathBuf>,
    /// The truths.
    pub(super) truths: Vec<PathBuf>,
}

/// The heads of a BIDS folder, in the order of their names.
///
/// # Errors
/// If the folder cannot be listed or has no head.
pub(super) fn heads(root: &Path, truths: &Truths) -> Result<Vec<HeadFiles>, BenchError> {
    let folders = listed(root)?;
    let is_head = |path: &PathBuf| path.is_dir() && name_of(path).starts_with("sub-");
    let heads: Result<Vec<_>, BenchError> = folders
        .into_iter()
        .filter(is_head)
        .map(|folder| head(&folder, truths))
        .collect();
    let heads = heads?;
    if heads.is_empty() {
        return Err(BenchError::Usage(format!(
            "{} has no folder sub-*: it is not a BIDS folder",
            root.display()
        )));
    }
    Ok(heads)
}

fn head(folder: &Path, truths: &Truths) -> Result<HeadFiles, BenchError> {
    let name = name_of(folder);
    let sessions = listed(folder)?.into_iter();
    let sessions = sessions.filter(|path| path.is_dir() && name_of(path).starts_with("ses-"));
    let scanned: Vec<PathBuf> = std::iter::once(folder.to_owned()).chain(sessions).collect();
    let images = |suffix: &str| -> Result<Vec<PathBuf>, BenchError> {
        let mut found = Vec::new();
        for ending in NIFTI {
            let pattern = format!("anat/*_{suffix}{ending}");
            for folder in &scanned {
                matching(folder, &pattern, &mut found)?;
            }
        }
        found.sort();
        Ok(found)
    };
    let id = name.trim_start_matches("sub-");
    let number = match id.trim_start_matches('0') {
        "" => id,
        number => number,
    };
    let pattern = truths.pattern.replace("{id}", id).replace("{n}", number);
    let mut marked = Vec::new();
    match &truths.folder {
        Some(folder) => matching(folder, &pattern, &mut marked)?,
        None => {
            for folder in &scanned {
                matching(folder, &pattern, &mut marked)?;
            }
        }
    }
    marked.sort();
    marked.dedup();
    Ok(HeadFiles {
        t1: images("T1w")?,
        flair: images("FLAIR")?,
        truths: marked,
        name,
    })
}

/// Adds the files below a folder that match a pattern with one part for each level.
fn matching(folder: &Path, pattern: &str, found: &mut Vec<PathBuf>) -> Result<(), BenchError> {
    let (part, rest) = match pattern.split_once('/') {
        Some((part, rest)) => (part, Some(rest)),
        None => (pattern, None),
    };
    if !folder.is_dir() {
        return Ok(());
    }
    for path in listed(folder)? {
        if !matches(part, &name_of(&path)) {
            continue;
        }
        match rest {
            Some(rest) => matching(&path, rest, found)?,
            None if path.is_file() => found.push(path),
            None => {}
        }
    }
    Ok(())
}

/// Whether a name matches a pattern in which `*` is any text.
fn matches(pattern: &str, name: &str) -> bool {
    match pattern.split_once('*') {
        None => pattern == name,
        Some((before, after)) => name.strip_prefix(before).is_some_and(|rest| {
            (0..=rest.len())
                .filter(|&at| rest.is_char_boundary(at))
                .any(|at| matches(after, &rest[at..]))
        }),
    }
}

/// The entries of a folder, in the order of their names.
fn listed(folder: &Path) -> Result<Vec<PathBuf>, BenchError> {
    let unreadable = |reason| BenchError::Unreadable {
        path: folder.to_owned(),
        reason,
    };
    let entries = std::fs::read_dir(folder).map_err(unreadable)?;
    let paths: Result<Vec<PathBuf>, _> = entries.map(|entry| Ok(entry?.path())).collect();
    let mut paths = paths.map_err(unreadable)?;
    paths.sort();
    Ok(paths)
}

/// The name of a file or folder.
pub(super) fn name_of(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// The name of a NIfTI file without its ending.
pub(super) fn stem_of(path: &Path) -> String {
    let name = name_of(path);
    let stem = NIFTI.iter().find_map(|ending| name.strip_suffix(ending));
    stem.unwrap_or(&name).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_star_is_any_text() {
        assert!(matches("*_roi.nii*", "sub-1_FLAIR_roi.nii.gz"));
        assert!(matches("a*b*c", "abbc") && matches("*", ""));
        assert!(!matches("*_roi.nii", "sub-1_roi.nii.gz") && !matches("a*b", "a"));
    }

    #[test]
    fn heads_are_found_with_sessions_and_with_truths_elsewhere() {
        let root = tempfile::tempdir().unwrap();
        let touch = |path: &str| {
            let path = root.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, b"").unwrap();
        };
        touch("sub-02/ses-b/anat/sub-02_ses-b_T1w.nii.gz");
        touch("sub-02/ses-a/anat/sub-02_ses-a_T1w.nii");
        touch("sub-02/ses-a/anat/sub-02_ses-a_FLAIR.nii.gz");
        touch("sub-02/ses-a/anat/sub-02_ses-a_T1w_roi.nii.gz");
        touch("masks/2/2_MaskInOrig.nii.gz");
        touch("sub-10/anat/sub-10_T1w.json");
        let beside = Truths {
            folder: None,
            pattern: "anat/*_roi.nii*".to_owned(),
        };
        let found = heads(root.path(), &beside).unwrap();
        let names: Vec<&str> = found.iter().map(|head| head.name.as_str()).collect();
        assert_eq!(names, ["sub-02", "sub-10"]);
        let t1: Vec<String> = found[0].t1.iter().map(|path| stem_of(path)).collect();
        assert_eq!(t1, ["sub-02_ses-a_T1w", "sub-02_ses-b_T1w"]);
        assert_eq!((found[0].flair.len(), found[0].truths.len()), (1, 1));
        assert!(found[1].t1.is_empty());
        let apart = Truths {
            folder: Some(root.path().join("masks")),
            pattern: "{n}/{n}_MaskInOrig.nii.gz".to_owned(),
        };
        let found = heads(root.path(), &apart).unwrap();
        assert_eq!(
            name_of(&found[0].truths[0]),
            "2_MaskInOrig.nii.gz",
            "the name without leading zeros"
        );
    }
}
