//! Inspections, and copies from one store into another.

use super::*;
use crate::upkeep::{Copied, CopyStep, Defect, Inspected};
use crate::{LayerName, LayerUpload, WrittenReading, frame};
use case::{Failure, JobKind, LayerParameters};

fn closer() -> Parameters {
    Parameters {
        closing_radius_mm: 8.0,
        ..Parameters::default()
    }
}

/// A ready case, a failed one, and a queued version of the first, oldest first.
async fn three_cases(directory: &TempDir) -> (Store, [CaseId; 3]) {
    let store = store(directory).await;
    // The clock of SQLite counts milliseconds.
    let later = async || tokio::time::sleep(Duration::from_millis(2)).await;
    let of = ready(&store, "volume").await;
    later().await;
    let failed = submit(&store, "bad").await.unwrap().case.id;
    let claimed = claim(&store).await.unwrap();
    assert!(store.finish(&claimed, Err(&failure())).await.unwrap());
    let version = Version {
        of,
        mask: NewMask::Kept,
        parameters: closer(),
    };
    later().await;
    let version = store.submit_version(version).await.unwrap().unwrap();
    (store, [of, failed, version.case.id])
}

async fn object(store: &Store, id: &CaseId, kind: ObjectKind) -> ObjectName {
    let names = store.objects_of(id).await.unwrap();
    *names.iter().find(|name| name.kind == kind).unwrap()
}

fn file_of(directory: &TempDir, name: &ObjectName) -> std::path::PathBuf {
    directory.path().join("objects").join(name.path().as_ref())
}

async fn inspected(store: &Store) -> (Inspected, Vec<Defect>) {
    let mut findings = Vec::new();
    let inspected = upkeep::inspect(store, &mut |finding| findings.push(finding)).await;
    (inspected.unwrap(), findings)
}

#[tokio::test]
async fn an_inspection_counts_what_is_sound_and_reports_the_rest() {
    let directory = tempfile::tempdir().unwrap();
    let (store, [of, failed, version]) = three_cases(&directory).await;
    let (sound, findings) = inspected(&store).await;
    assert_eq!(findings, []);
    // The first has a source and six derived objects, the others have a source; two sources are the same object. Each has a
    // manifest.
    let derived: usize = (ObjectKind::DERIVED.iter())
        .map(|kind| kind.name().len() + " of volume".len())
        .sum();
    let mut bytes = (derived + 2 * "volume".len() + "bad".len()) as u64;
    for id in [&of, &failed, &version] {
        let manifest = object(&store, id, ObjectKind::Manifest).await;
        bytes += store.object(&manifest).await.unwrap().len() as u64;
    }
    let expected = Inspected {
        cases: 3,
        objects: 12,
        bytes,
    };
    assert_eq!(sound, expected);

    let [shared, paths] = [
        object(&store, &of, ObjectKind::SourceVolume).await,
        object(&store, &of, ObjectKind::Paths).await,
    ];
    let gone = object(&store, &failed, ObjectKind::SourceVolume).await;
    std::fs::write(file_of(&directory, &shared), b"damaged").unwrap();
    std::fs::write(file_of(&directory, &paths), b"").unwrap();
    std::fs::remove_file(file_of(&directory, &gone)).unwrap();
    let stray = frame(ObjectKind::Mask, "stray".into());
    store.objects().put(&stray).await.unwrap();
    let (_, findings) = inspected(&store).await;
    let expected = [
        Defect::Damaged(Some(version), shared),
        Defect::Missing(Some(failed), gone),
        Defect::Damaged(Some(of), paths),
        Defect::Damaged(Some(of), shared),
        Defect::Unreferenced(stray.name),
    ];
    assert_eq!(findings, expected);
    assert!(file_of(&directory, &stray.name).exists(), "nothing changes");
}

#[tokio::test]
async fn an_inspection_turns_the_pages() {
    let options = Options {
        queue_limit: 1000,
        ..Options::default()
    };
    let store = Store::in_memory(options).await.unwrap();
    for tenths in 0..230 {
        let parameters = Parameters {
            closing_radius_mm: f64::from(tenths) / 10.0,
            ..Parameters::default()
        };
        let upload = upload(&store, "volume", None).await;
        store.submit(upload, parameters, None, false).await.unwrap();
    }
    let (inspected, findings) = inspected(&store).await;
    assert_eq!((inspected.cases, inspected.objects), (230, 460));
    assert_eq!(findings, []);
}

/// Copies, and returns the result with each case and whether it was copied.
async fn copied(from: &Store, to: &Store) -> (Copied, Vec<(CaseId, bool)>) {
    let mut reported = Vec::new();
    let mut report = |step: CopyStep, _: &Copied| match step {
        CopyStep::Case(id) => reported.push((id, true)),
        CopyStep::LostCase(id) => reported.push((id, false)),
    };
    let copied = upkeep::copy_into(from, to, &mut report).await.unwrap();
    (copied, reported)
}

#[tokio::test]
async fn a_copy_has_the_same_cases_and_the_next_one_writes_nothing() {
    let [here, there] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let (from, ids) = three_cases(&here).await;
    let to = store(&there).await;
    let none = from.findings(&ids[0]).await.unwrap().version;
    let found = from.replace_findings(&ids[0], none, "[1]".to_owned());
    assert!(matches!(found.await, Ok(Replaced::Done(_))));
    let begun = from.write_reading(&ids[0], "ana", None, "{}".to_owned());
    let WrittenReading::Done(begun) = begun.await.unwrap() else {
        panic!("a reading")
    };
    let chosen = from.replace_preferences("ana", None, Some("{}"));
    assert!(chosen.await.unwrap());
    let (first, reported) = copied(&from, &to).await;
    assert_eq!(reported, ids.map(|id| (id, true)), "the oldest first");
    let chosen = to.preferences("ana").await.unwrap();
    assert_eq!(chosen.as_deref(), Some("{}"));
    let files = objects_below(&there.path().join("objects"));
    let bytes = files.iter().map(|file| file.metadata().unwrap().len());
    let expected = Copied {
        cases: 3,
        objects: 11,
        bytes: bytes.sum(),
        kept: 1,
        ..Copied::default()
    };
    assert_eq!(first, expected);
    for id in &ids {
        let case = to.case(id).await.unwrap();
        assert_eq!(case, from.case(id).await.unwrap());
        let findings = to.findings(id).await.unwrap();
        assert_eq!(findings, from.findings(id).await.unwrap());
    }
    let copied_reading = to.reading(&ids[0], "ana", 1).await.unwrap();
    assert_eq!(copied_reading.as_ref(), Some(&begun));
    assert_eq!(
        waiting(&to, JobKind::PREPARE).await,
        1,
        "the version is prepared there"
    );
    assert_nothing_left_over(&to, there.path()).await;

    let signed = from.sign_reading(&ids[0], &begun).await;
    assert!(matches!(signed, Ok(WrittenReading::Done(_))));
    let there_since = to.replace_preferences("ana", Some("{}"), Some("since"));
    assert!(there_since.await.unwrap());
    let (again, _) = copied(&from, &to).await;
    assert_eq!((again.objects, again.bytes, again.kept), (0, 0, 12));
    let chosen = to.preferences("ana").await.unwrap();
    assert_eq!(chosen.as_deref(), Some("since"), "the later one");
    let readings = to.readings(&ids[0]).await.unwrap();
    assert!(readings[0].signed_at.is_some());
    assert_eq!(readings, from.readings(&ids[0]).await.unwrap());
    let damaged = object(&to, &ids[0], ObjectKind::Forest).await;
    std::fs::write(file_of(&there, &damaged), b"damaged").unwrap();
    let (mended, _) = copied(&from, &to).await;
    assert_eq!((mended.objects, mended.kept), (1, 11));
    assert_eq!(inspected(&to).await.1, []);
}

#[tokio::test]
async fn without_its_source_a_case_is_not_copied_but_without_derived_objects_it_is() {
    let [here, there] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let (from, [of, failed, version]) = three_cases(&here).await;
    let source = object(&from, &failed, ObjectKind::SourceVolume).await;
    std::fs::write(file_of(&here, &source), b"damaged").unwrap();
    let derived = object(&from, &of, ObjectKind::Volume).await;
    std::fs::remove_file(file_of(&here, &derived)).unwrap();
    let to = store(&there).await;
    let (result, reported) = copied(&from, &to).await;
    assert_eq!(reported, [(of, true), (failed, false), (version, true)]);
    assert_eq!((result.cases, result.lost), (2, 1));
    assert_eq!(to.case(&failed).await.unwrap(), None);
    assert!(!file_of(&there, &source).exists());
    // It is rebuilt there when it is first read.
    assert!(matches!(read(&to, &of).await, Attempt::Bad));
}

/// Makes a file look some days old.
fn age(file: &std::path::Path, days: u64) {
    let then = std::time::SystemTime::now() - Duration::from_secs(days * 86_400);
    let file = std::fs::File::options().write(true).open(file).unwrap();
    file.set_modified(then).unwrap();
}

#[tokio::test]
async fn what_nothing_refers_to_is_told_by_its_age_and_by_that_of_the_rows() {
    let directory = tempfile::tempdir().unwrap();
    let store = store(&directory).await;
    let put = async |contents: &'static str, days| {
        let stray = frame(ObjectKind::Mask, contents.into());
        store.objects().put(&stray).await.unwrap();
        age(&file_of(&directory, &stray.name), days);
        stray.name
    };
    let [old, _young] = [put("old", 8).await, put("young", 6).await];
    let found = upkeep::unreferenced(&store).await.unwrap();
    assert!(found.is_newer_than_rows, "there is no row");
    ready(&store, "volume").await;
    let found = upkeep::unreferenced(&store).await.unwrap();
    assert!(!found.is_newer_than_rows && found.is_much());
    assert_eq!(found.names, [old]);
    assert_eq!((found.old.objects, found.young.objects), (1, 1));
    let files = objects_below(&directory.path().join("objects"));
    assert_eq!(
        found.all.objects,
        files.len() as u64,
        "nothing is left of the clock"
    );
    let newer = put("newer", 0).await;
    assert!(
        upkeep::unreferenced(&store)
            .await
            .unwrap()
            .is_newer_than_rows
    );
    upkeep::remove_unreferenced(&store, &[newer]).await.unwrap();
    for number in 0..20 {
        let volume = store.spools().of(format!("volume {number}").into()).await;
        let upload = Upload {
            volume: volume.unwrap(),
            mask: None,
            dicom: None,
            images: Vec::new(),
            series: None,
        };
        store
            .submit(upload, Parameters::default(), None, false)
            .await
            .unwrap();
        let claimed = claim(&store).await.unwrap();
        assert!(store.finish(&claimed, Err(&failure())).await.unwrap());
    }
    let found = upkeep::unreferenced(&store).await.unwrap();
    assert!(!found.is_newer_than_rows && !found.is_much(), "{found:?}");
}

/// A failure because of a damaged source.
fn source_damaged() -> Failure {
    Failure::source_damaged()
}

#[tokio::test]
async fn a_case_that_failed_though_its_sources_are_whole_is_named_and_prepared_again() {
    let directory = tempfile::tempdir().unwrap();
    let store = store(&directory).await;
    let [whole, lost] = [ready(&store, "whole").await, ready(&store, "lost").await];
    for id in [whole, lost] {
        assert!(
            store
                .make_case_failed(&id, &source_damaged())
                .await
                .unwrap()
        );
    }
    let source = object(&store, &lost, ObjectKind::SourceVolume).await;
    let file = file_of(&directory, &source);
    let away = directory.path().join("away");
    std::fs::rename(&file, &away).unwrap();
    let (_, mut findings) = inspected(&store).await;
    findings.sort_by_key(|finding| matches!(finding, Defect::FailedThoughWhole(_)));
    let missing = Defect::Missing(Some(lost), source);
    assert_eq!(findings, [missing, Defect::FailedThoughWhole(whole)]);
    std::fs::rename(&away, &file).unwrap();
    let (_, findings) = inspected(&store).await;
    assert_eq!(findings.len(), 2);
    for id in [whole, lost] {
        assert!(findings.contains(&Defect::FailedThoughWhole(id)));
        assert!(store.prepare_again(&id, CaseState::Failed).await.unwrap());
        assert!(!store.prepare_again(&id, CaseState::Failed).await.unwrap());
        let case = store.case(&id).await.unwrap().unwrap();
        assert_eq!((case.state, case.failure), (CaseState::Queued, None));
    }
    assert_eq!(waiting(&store, JobKind::PREPARE).await, 2);
    assert_eq!(inspected(&store).await.1, []);
    // Another failure is what the input is like.
    for _ in 0..2 {
        let claimed = claim(&store).await.unwrap();
        assert!(store.finish(&claimed, Err(&failure())).await.unwrap());
    }
    assert_eq!(inspected(&store).await.1, []);
}

#[tokio::test]
async fn a_lost_manifest_is_written_again() {
    let directory = tempfile::tempdir().unwrap();
    let store = store(&directory).await;
    let case = ready(&store, "volume").await;
    let upload = LayerUpload {
        case,
        volume: store.spools().of("a T2".into()).await.unwrap(),
        dicom: None,
        images: Vec::new(),
        series: None,
        name: LayerName::Usual("T2".to_owned()),
        parameters: LayerParameters::default(),
    };
    store.submit_layer(upload).await.unwrap();
    let manifests = files_below(&directory.path().join("objects/manifest"));
    let contents: Vec<_> = manifests
        .iter()
        .map(|file| std::fs::read(file).unwrap())
        .collect();
    assert_eq!(manifests.len(), 2, "one of the case and one of its layer");
    std::fs::remove_file(&manifests[0]).unwrap();
    std::fs::write(&manifests[1], b"damaged").unwrap();
    assert_eq!(inspected(&store).await.1.len(), 2);
    upkeep::restore_manifests(&store, &case).await.unwrap();
    assert_eq!(inspected(&store).await.1, []);
    for (file, contents) in manifests.iter().zip(contents) {
        assert!(
            std::fs::read(file).unwrap() == contents,
            "they are the same"
        );
    }
    assert_nothing_left_over(&store, directory.path()).await;
}
