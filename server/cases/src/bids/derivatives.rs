//! The folder of what is derived from the heads of a BIDS folder.

use std::fs::Permissions;
use std::io::{ErrorKind, Write as _};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::folder::HeadName;
use super::names::ends;
use super::record::{HeadRecord, MadeWith};

/// The version of BIDS that the names follow.
const BIDS_VERSION: &str = "1.10.0";

/// The name by which it is known who made the folder.
const GENERATOR: &str = "Isocortex";

/// How the name of a file ends that is not yet written whole.
const PART: &str = ".part";

/// What validators leave out: BIDS has no names for maps, places, surfaces and transforms yet, nor for reports and pictures.
const IGNORED: &str =
    "*.html\nsummary.tsv\nsub-*/figures\n*_map.*\n*_desc-places.*\n*.surf.gii\n*_xfm.json\n";

/// Why the folder cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    #[error("{} cannot be written: {source}", .path.display())]
    Unwritable {
        path: PathBuf,
        source: std::io::Error,
    },
    /// It is that of another program.
    #[error(
        "{} was made by another program, as its dataset_description.json says; name another folder", .path.display()
    )]
    OfAnother { path: PathBuf },
    /// It may be that of another program.
    #[error(
        "{} has folders of subjects and no dataset_description.json, so it may belong to another program; name another folder", .path.display()
    )]
    Undescribed { path: PathBuf },
    /// The acquired volumes would lie beside what is derived from them.
    #[error("the output folder is the BIDS folder itself; name another one, such as {}/derivatives/isocortex", .path.display())]
    Same { path: PathBuf },
}

/// The folder of the derivatives.
#[derive(Debug, Clone)]
pub struct Derivatives {
    root: PathBuf,
}

impl Derivatives {
    /// Makes the folder with its description, or opens the one that an earlier run made from the BIDS folder `raw`.
    ///
    /// # Errors
    /// If it cannot be written, or belongs to another program.
    pub fn open(root: &Path, raw: &Path, made_with: &MadeWith) -> Result<Self, OutputError> {
        let this = Self {
            root: root.to_owned(),
        };
        let unwritable = |source| OutputError::Unwritable {
            path: root.to_owned(),
            source,
        };
        std::fs::create_dir_all(root).map_err(unwritable)?;
        let raw = raw.canonicalize().map_err(unwritable)?;
        if root.canonicalize().map_err(unwritable)? == raw {
            return Err(OutputError::Same { path: raw });
        }
        let path = root.join("dataset_description.json");
        if let Some(known) = read(&path)? {
            let known: Value = serde_json::from_slice(&known).unwrap_or_default();
            if known["GeneratedBy"][0]["Name"] != GENERATOR {
                return Err(OutputError::OfAnother {
                    path: root.to_owned(),
                });
            }
        } else if has_subjects(root).map_err(unwritable)? {
            return Err(OutputError::Undescribed {
                path: root.to_owned(),
            });
        }
        this.write_json(
            &path,
            &json!({
                "Name": "Isocortex: depth below the dura, maps of the cortex, and their places",
                "BIDSVersion": BIDS_VERSION,
                "DatasetType": "derivative",
                "GeneratedBy": [{"Name": GENERATOR, "Version": made_with.version, "Description": "isocortex bids"}],
                "DatasetLinks": {"raw": format!("file://{}", encoded(&raw.to_string_lossy()))},
            }),
        )?;
        for (name, text) in [(".bidsignore", IGNORED), ("README.md", README)] {
            let path = root.join(name);
            // The user may have put one there.
            if read(&path)?.is_none() {
                this.write(&path, text.as_bytes())?;
            }
        }
        Ok(this)
    }

    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The folder of the files of a head.
    fn anat(&self, name: &HeadName) -> PathBuf {
        self.root.join(&name.folder).join("anat")
    }

    /// The file of a head with this end of its name.
    pub fn path(&self, name: &HeadName, end: &str) -> PathBuf {
        self.anat(name).join(format!("{}_{end}", name.prefix))
    }

    /// The report of a head.
    pub fn report(&self, name: &HeadName) -> PathBuf {
        self.root.join(format!("{}.html", name.prefix))
    }

    /// The folder of the pictures of a subject.
    fn figures(&self, name: &HeadName) -> PathBuf {
        let subject: PathBuf = name.folder.components().take(1).collect();
        self.root.join(subject).join("figures")
    }

    /// The picture of a head.
    pub fn picture(&self, name: &HeadName) -> PathBuf {
        let file = format!("{}_desc-cut.png", name.prefix);
        self.figures(name).join(file)
    }

    /// The file that is written last.
    fn record_path(&self, name: &HeadName) -> PathBuf {
        self.path(name, "desc-brain_mask.json")
    }

    /// A path relative to the root.
    pub fn relative(&self, path: &Path) -> String {
        let relative = path.strip_prefix(&self.root).unwrap_or(path);
        relative.to_string_lossy().into_owned()
    }

    /// The address of a file in a page at the root.
    pub fn address(&self, path: &Path) -> String {
        encoded(&self.relative(path))
    }

    /// What an earlier run recorded of a head, if all of its files are there.
    ///
    /// # Errors
    /// If it is there and cannot be read.
    pub fn record(&self, name: &HeadName) -> Result<Option<HeadRecord>, OutputError> {
        let record = read(&self.record_path(name))?;
        let record = record.and_then(|bytes| serde_json::from_slice::<HeadRecord>(&bytes).ok());
        let is_whole = |record: &HeadRecord| {
            record
                .files
                .iter()
                .all(|file| self.root.join(file).is_file())
        };
        Ok(record.filter(is_whole))
    }

    /// Records that a head is done.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(&self, name: &HeadName, record: &HeadRecord) -> Result<(), OutputError> {
        let record = serde_json::to_value(record).unwrap_or_default();
        self.write_json(&self.record_path(name), &record)
    }

    /// Removes what an earlier run wrote of a head, the record first, and the parts of files of a run that was killed. What others have put
    /// beside it stays.
    ///
    /// # Errors
    /// If something cannot be removed.
    pub fn clear(&self, name: &HeadName) -> Result<(), OutputError> {
        let gone = |path: &Path| match std::fs::remove_file(path) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(OutputError::Unwritable {
                path: path.to_owned(),
                source: error,
            }),
            _ => Ok(()),
        };
        gone(&self.record_path(name))?;
        let of_head = ends().map(|end| self.path(name, &end));
        let own: Vec<_> = of_head
            .chain([
                self.record_path(name),
                self.picture(name),
                self.report(name),
            ])
            .collect();
        let folders = [self.anat(name), self.figures(name), self.root.clone()];
        let entries = folders.iter().flat_map(std::fs::read_dir).flatten();
        let parts = entries.flatten().map(|entry| entry.path());
        let parts = parts.filter(|path| is_part_of(path, &own));
        for path in parts.chain(own.iter().cloned()) {
            gone(&path)?;
        }
        Ok(())
    }

    /// Writes a whole file: under a name of its own first, so that whoever ends the program leaves no part of it, and programs with one folder
    /// do not meet.
    ///
    /// # Errors
    /// If it, or its folder, cannot be written.
    pub fn write(&self, path: &Path, bytes: &[u8]) -> Result<(), OutputError> {
        let folder = path.parent().unwrap_or(&self.root);
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let write = || {
            std::fs::create_dir_all(folder)?;
            let mut part = tempfile::Builder::new()
                .prefix(&format!(".{name}."))
                .suffix(PART)
                // As those of other files: the process restricts them.
                .permissions(Permissions::from_mode(0o666))
                .tempfile_in(folder)?;
            part.write_all(bytes)?;
            part.persist(path)?;
            Ok(())
        };
        write().map_err(|source| OutputError::Unwritable {
            path: path.to_owned(),
            source,
        })
    }

    /// The same, of a JSON value.
    ///
    /// # Errors
    /// As [`Derivatives::write`].
    pub fn write_json(&self, path: &Path, value: &Value) -> Result<(), OutputError> {
        self.write(path, format!("{value:#}\n").as_bytes())
    }
}

/// Whether the folder has one of a subject.
fn has_subjects(root: &Path) -> std::io::Result<bool> {
    for entry in std::fs::read_dir(root)? {
        let entry = entry?;
        let is_named = entry.file_name().to_string_lossy().starts_with("sub-");
        if is_named && entry.file_type()?.is_dir() {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Whether a file is what [`Derivatives::write`] left of one of these when it was killed.
fn is_part_of(path: &Path, whole: &[PathBuf]) -> bool {
    let file = path.file_name().unwrap_or_default().to_string_lossy();
    let Some(part) = file.strip_prefix('.').filter(|file| file.ends_with(PART)) else {
        return false;
    };
    whole.iter().any(|whole| {
        let name = whole.file_name().unwrap_or_default().to_string_lossy();
        let rest = part.strip_prefix(&*name);
        whole.parent() == path.parent() && rest.is_some_and(|rest| rest.starts_with('.'))
    })
}

fn read(path: &Path) -> Result<Option<Vec<u8>>, OutputError> {
    match std::fs::read(path) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(source) => Err(OutputError::Unwritable {
            path: path.to_owned(),
            source,
        }),
    }
}

/// A path in a URI.
pub(super) fn encoded(path: &str) -> String {
    let letter = |byte: u8| match byte {
        b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'_' | b'.' | b'~' | b'/' => {
            char::from(byte).to_string()
        }
        other => format!("%{other:02X}"),
    };
    path.bytes().map(letter).collect()
}

const README: &str = "\
# Derivatives of Isocortex

`isocortex bids` made these files. **For research use only. Not for diagnosis.** Most places that maps list are normal: nothing is detected.

`summary.html` shows all heads, `summary.tsv` states why one has no files, and each head has a report, `sub-….html`. All volumes have the grid of the
T1-weighted volume, all positions are in its scanner space (RAS, mm):

- `desc-brain_mask`: the brain; its JSON has the verdict on it, and is written last, when a head is complete.
- `desc-depth_map`: the depth below the envelope of the brain in mm, NaN outside.
- `desc-blur_map`, `desc-thickness_map`, `desc-flair_map`: robust z values, NaN where they are undefined.
- `desc-sides_dseg`, `desc-regions_dseg`, `desc-blurplaces_dseg` …: labels, with their names in a table.
- `desc-places.tsv`: the places that the maps list.
- `hemi-L_desc-8mm_cut.surf.gii`: the cut 8 mm below the envelope of a half of the cerebrum.
- `from-FLAIR_to-T1w_mode-image_xfm.json`: where the FLAIR lies.
";

#[cfg(test)]
mod tests {
    use super::*;

    fn open(folder: &Path) -> Derivatives {
        let raw = folder.join("raw");
        std::fs::create_dir_all(&raw).unwrap();
        let out = folder.join("out");
        Derivatives::open(&out, &raw, &MadeWith::new("0", None, "")).unwrap()
    }

    #[test]
    fn several_programs_write_into_one_folder() {
        let folder = tempfile::tempdir().unwrap();
        let out = open(folder.path());
        let path = out.root().join("summary.tsv");
        std::thread::scope(|scope| {
            let write = |letter: u8| {
                let (out, path) = (&out, &path);
                scope.spawn(move || {
                    for _ in 0..200 {
                        out.write(path, &[letter; 4096]).unwrap();
                    }
                })
            };
            let _threads = [b'a', b'b', b'c'].map(write);
            for _ in 0..200 {
                let found = read(&path).unwrap().unwrap_or_default();
                assert!(found.iter().all(|letter| *letter == found[0]));
                assert!([0, 4096].contains(&found.len()));
            }
        });
        let plain = out.root().join("plain");
        std::fs::write(&plain, "").unwrap();
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&path), mode(&plain));
    }

    #[test]
    fn parts_of_a_killed_run_go_and_what_the_user_wrote_stays() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("out");
        std::fs::create_dir_all(&root).unwrap();
        std::fs::write(root.join("README.md"), "mine").unwrap();
        std::fs::write(root.join("sub-1.log"), "").unwrap();
        let out = open(folder.path());
        std::fs::create_dir_all(root.join("sub-1/anat")).unwrap();
        std::fs::create_dir_all(root.join("sub-1/figures")).unwrap();
        let own = [
            "sub-1/anat/sub-1_desc-depth_map.nii.gz",
            "sub-1/anat/.sub-1_desc-depth_map.nii.gz.abc.part",
            "sub-1/anat/.sub-1_desc-brain_mask.json.abc.part",
            "sub-1/figures/.sub-1_desc-cut.png.abc.part",
            "sub-1/figures/sub-1_desc-cut.png",
            ".sub-1.html.abc.part",
            "sub-1.html",
        ];
        let other = [
            "sub-1/anat/sub-1_desc-lesion_roi.nii.gz",
            "sub-1/anat/sub-1_hemi-L_pial.surf.gii",
            "sub-1/anat/sub-1_run-2_desc-depth_map.nii.gz",
            "sub-1/anat/.sub-1_run-2_desc-depth_map.nii.gz.abc.part",
            "sub-10.html",
        ];
        for file in own.iter().chain(&other) {
            std::fs::write(root.join(file), "").unwrap();
        }
        let name = HeadName {
            folder: "sub-1".into(),
            prefix: "sub-1".to_owned(),
        };
        out.clear(&name).unwrap();
        let is_there = |file: &&str| root.join(file).exists();
        assert!(!own.iter().any(is_there));
        assert!(other.iter().all(is_there));
        let readme = std::fs::read_to_string(root.join("README.md")).unwrap();
        assert_eq!(readme, "mine");
        // If the description is missing, the folder may belong to another program.
        std::fs::remove_file(root.join("dataset_description.json")).unwrap();
        let opened = Derivatives::open(&root, folder.path(), &MadeWith::new("0", None, ""));
        assert!(matches!(opened, Err(OutputError::Undescribed { .. })));
    }
}
