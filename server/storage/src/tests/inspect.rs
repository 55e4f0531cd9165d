//! Inspections, and copies from one store into another.

use super::*;
use crate::frame;

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
    assert!(store.fail(&claimed, &failure()).await.unwrap());
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
    let names = store.case_objects(id).await.unwrap();
    *names.iter().find(|name| name.kind == kind).unwrap()
}

fn file_of(directory: &TempDir, name: &ObjectName) -> std::path::PathBuf {
    directory.path().join("objects").join(name.path().as_ref())
}

async fn inspected(store: &Store) -> (Inspected, Vec<Finding>) {
    let mut findings = Vec::new();
    let inspected = store.inspect(&mut |finding| findings.push(finding)).await;
    (inspected.unwrap(), findings)
}

#[tokio::test]
async fn an_inspection_counts_what_is_sound_and_reports_the_rest() {
    let directory = tempfile::tempdir().unwrap();
    let (store, [of, failed, version]) = three_cases(&directory).await;
    let (sound, findings) = inspected(&store).await;
    assert_eq!(findings, []);
    // The first has a source and six derived objects, the others have a source; two sources are the same object.
    let derived: usize = (ObjectKind::DERIVED.iter())
        .map(|kind| kind.name().len() + " of volume".len())
        .sum();
    let bytes = (derived + 2 * "volume".len() + "bad".len()) as u64;
    let expected = Inspected {
        cases: 3,
        objects: 9,
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
        Finding::Damaged(version, shared),
        Finding::Missing(failed, gone),
        Finding::Damaged(of, paths),
        Finding::Damaged(of, shared),
        Finding::Unreferenced(stray.name),
    ];
    assert_eq!(findings, expected);
    assert!(file_of(&directory, &stray.name).exists(), "nothing changes");
}

#[tokio::test]
async fn an_inspection_reads_the_images_of_a_pacs() {
    let directory = tempfile::tempdir().unwrap();
    let store = store(&directory).await;
    let uid = |text: &str| crate::arrivals::Uid::parse(text).unwrap();
    let mut images = Vec::new();
    for number in 0..3 {
        let mut file = store.spool().await.unwrap();
        let content = format!("image {number}").into_bytes();
        file.write(content.into()).await.unwrap();
        let file = file.finish().await.unwrap();
        let new = crate::arrivals::NewInstance {
            uids: crate::arrivals::SeriesUids {
                study: uid("1.2"),
                series: uid("1.2.3"),
            },
            accession_number: None,
            sop_instance_uid: uid(&format!("1.2.3.{number}")),
            digest: *file.digest(),
        };
        images.push((new, file));
    }
    let names: Vec<_> = images
        .iter()
        .map(|(new, _)| ObjectName::from(new))
        .collect();
    let source = crate::arrivals::ArrivalSource::Stow;
    assert_eq!(store.receive(images, source).await.unwrap(), 3);
    let (sound, findings) = inspected(&store).await;
    assert_eq!((sound.cases, sound.objects, findings), (0, 3, vec![]));

    std::fs::write(file_of(&directory, &names[0]), b"damaged").unwrap();
    std::fs::remove_file(file_of(&directory, &names[1])).unwrap();
    let (_, mut findings) = inspected(&store).await;
    findings.sort_by_key(|finding| matches!(finding, Finding::DamagedForPacs(_)));
    let expected = [
        Finding::MissingForPacs(names[1]),
        Finding::DamagedForPacs(names[0]),
    ];
    assert_eq!(findings, expected);
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
        store.submit_upload(upload, parameters).await.unwrap();
    }
    let (inspected, findings) = inspected(&store).await;
    assert_eq!((inspected.cases, inspected.objects), (230, 230));
    assert_eq!(findings, []);
}

/// Copies, and returns the result with each case and whether it was copied.
async fn copied(from: &Store, to: &Store) -> (Copied, Vec<(CaseId, bool)>) {
    let mut reported = Vec::new();
    let mut report = |id: &CaseId, is_whole: bool, _: &Copied| reported.push((*id, is_whole));
    let copied = from.copy_into(to, &mut report).await.unwrap();
    (copied, reported)
}

#[tokio::test]
async fn a_copy_has_the_same_cases_and_the_next_one_writes_nothing() {
    let [here, there] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let (from, ids) = three_cases(&here).await;
    let to = store(&there).await;
    let (first, reported) = copied(&from, &to).await;
    assert_eq!(reported, ids.map(|id| (id, true)), "the oldest first");
    let files = files_below(&there.path().join("objects"));
    let bytes = files.iter().map(|file| file.metadata().unwrap().len());
    let expected = Copied {
        cases: 3,
        objects: 8,
        bytes: bytes.sum(),
        kept: 1,
        lost: 0,
    };
    assert_eq!(first, expected);
    for id in &ids {
        let case = to.case(id).await.unwrap();
        assert_eq!(case, from.case(id).await.unwrap());
    }
    assert_eq!(
        to.waiting().await.unwrap(),
        1,
        "the version is prepared there"
    );
    assert_nothing_left_over(&to, there.path()).await;

    let (again, _) = copied(&from, &to).await;
    assert_eq!((again.objects, again.bytes, again.kept), (0, 0, 9));
    let damaged = object(&to, &ids[0], ObjectKind::Forest).await;
    std::fs::write(file_of(&there, &damaged), b"damaged").unwrap();
    let (mended, _) = copied(&from, &to).await;
    assert_eq!((mended.objects, mended.kept), (1, 8));
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
