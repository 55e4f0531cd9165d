//! Encrypted objects, by the commands of `docs/install.md`.

use std::path::Path;

use storage::testing::files_below;

use crate::command_line::{done, run};
use crate::head::plain_head;
use crate::operation::{Logged, get, get_bytes};

/// How many files of a folder are encrypted, and how many are not; without the names of the keys.
fn files(objects: &Path) -> (usize, usize) {
    let files = files_below(objects).into_iter();
    let files: Vec<_> = files
        .filter(|file| !file.starts_with(objects.join("keys")))
        .collect();
    let is_sealed =
        |file: &&std::path::PathBuf| std::fs::read(file).unwrap().starts_with(b"ISOCENC\n");
    let sealed = files.iter().filter(is_sealed).count();
    (sealed, files.len() - sealed)
}

#[test]
fn a_store_is_encrypted_copied_and_opened_with_its_key_alone() {
    let root = tempfile::tempdir().unwrap();
    let path = |name: &str| root.path().join(name).display().to_string();
    let (volume, data, keys) = (path("head.nii"), path("data"), path("keys"));
    std::fs::write(&volume, plain_head().bytes()).unwrap();
    let id = done(&["prepare", &volume, "--data", &data]);
    let id = id.lines().next().unwrap().to_owned();
    let objects = root.path().join("data/objects");
    let count = files(&objects).1;
    let picture = |data: &str, key: &[&str]| {
        let output = path("picture.png");
        let command = ["render", &id, "--data", data, "--output", &output];
        let (status, said) = run(&[&command[..], key].concat());
        assert_eq!(status, Some(0), "{said}");
        std::fs::read(output).unwrap()
    };
    let before = picture(&data, &[]);

    // The objects of before are encrypted by a command; pictures stay as they were.
    let key = done(&["key", "new", "--file", &keys]);
    let key = key.lines().next().unwrap().to_owned();
    let with_key = ["--key-file", &keys];
    assert!(picture(&data, &with_key) == before);
    let check = ["check-store", "--data", &data, "--key-file", &keys];
    let checked = done(&check);
    let words = format!("not encrypted with the current key: {count} objects");
    assert!(checked.contains(&words), "{checked}");
    let rekey = ["rekey", "--data", &data, "--key-file", &keys];
    let said = done(&rekey);
    let words =
        format!("encrypted with the key {key}: {count} objects; encrypted with it before: 0");
    assert!(said.contains(&words), "{said}");
    assert_eq!(files(&objects), (count, 0));
    assert!(picture(&data, &with_key) == before);
    assert!(!done(&check).contains("not encrypted"));

    // Without the key, or with another, every command says so, and nothing is damaged or rebuilt.
    let other = path("other");
    done(&["key", "new", "--file", &other]);
    let copy = path("copy");
    for wrong in [&[][..], &["--key-file", &other]] {
        for command in [
            &[
                "serve",
                "--data",
                &data,
                "--listen",
                "127.0.0.1:0",
                "--gpu",
                "off",
            ][..],
            &["work", "--data", &data],
            &["prepare", &volume, "--data", &data],
            &["check-store", "--data", &data, "--repair"],
            &["remove-expired", "--data", &data, "--keep-days", "1"],
            &["render", &id, "--data", &data, "--output", &path("a.png")],
            &["migrate-store", "--from", &data, "--to", &copy],
        ] {
            let (status, said) = run(&[command, wrong].concat());
            assert_eq!(status, Some(78), "{command:?}: {said}");
            assert!(
                said.contains(&format!("encrypted with the key {key}")),
                "{said}"
            );
            assert!(said.contains("storage.key_file"), "{said}");
        }
    }
    std::fs::write(&other, "secret\n").unwrap();
    let (status, said) = run(&["check-config", "--key-file", &other]);
    assert_eq!(status, Some(78), "{said}");
    assert!(
        said.contains("line 1 is no key") && !said.contains("secret"),
        "{said}"
    );
    assert!(done(&["check-config", "--key-file", &keys]).contains(&key));
    let (status, said) = run(&["rekey", "--data", &data]);
    assert_eq!(status, Some(2), "{said}");
    assert_eq!(files(&objects), (count, 0));
    assert!(done(&check).contains("read: 1 cases"));

    // A backup is encrypted too, and a decrypted copy is made with a file that begins with `none`.
    done(&[
        "migrate-store",
        "--from",
        &data,
        "--to",
        &copy,
        "--key-file",
        &keys,
    ]);
    assert_eq!(files(&root.path().join("copy/objects")), (count, 0));
    assert!(picture(&copy, &with_key) == before);
    let text = std::fs::read_to_string(&keys).unwrap();
    let leaving = path("leaving");
    std::fs::write(&leaving, format!("none\n{text}")).unwrap();
    let plain = path("plain");
    done(&[
        "migrate-store",
        "--from",
        &copy,
        "--to",
        &plain,
        "--key-file",
        &leaving,
    ]);
    assert_eq!(files(&root.path().join("plain/objects")), (0, count));
    assert!(picture(&plain, &[]) == before);
}

#[test]
fn a_running_server_goes_on_while_its_key_is_changed() {
    let root = tempfile::tempdir().unwrap();
    let path = |name: &str| root.path().join(name).display().to_string();
    let (volume, data, keys) = (path("head.nii"), path("data"), path("keys"));
    std::fs::write(&volume, plain_head().bytes()).unwrap();
    let first = done(&["key", "new", "--file", &keys]);
    let prepare = ["prepare", &volume, "--data", &data, "--key-file", &keys];
    let id = done(&prepare);
    let id = id.lines().next().unwrap().to_owned();
    // No case stays in its memory.
    let config = path("isocortex.toml");
    std::fs::write(&config, "[render]\ncache_bytes = 0\n").unwrap();
    let mut server = Logged::serve(&data, &["--key-file", &keys, "--config", &config]);
    let line = server.until("listening");
    let address = line["address"].as_str().unwrap().to_owned();
    let mask = || {
        let (status, mask) = get_bytes(&address, &format!("/v1/cases/{id}/mask"), "");
        assert_eq!(status, 200);
        mask
    };
    let before = mask();
    let second = done(&["key", "new", "--file", &keys]);
    let said = done(&["rekey", "--data", &data, "--key-file", &keys]);
    for id in [&first, &second] {
        assert!(said.contains(id.lines().next().unwrap()), "{said}");
    }
    assert!(said.contains("no longer needed by this store"), "{said}");
    assert!(mask() == before);
    server.until("the keys of the store were read again");
    // The first key is not needed.
    let text = std::fs::read_to_string(&keys).unwrap();
    let lines: Vec<_> = text.lines().filter(|line| !line.starts_with('#')).collect();
    assert_eq!(lines.len(), 2);
    std::fs::write(&keys, format!("{}\n", lines[0])).unwrap();
    assert!(mask() == before);
    let (_, metrics) = get(&address, "/metrics", "");
    assert!(
        metrics.contains("isocortex_bad_objects_total 0"),
        "{metrics}"
    );
    server.end();
}
