//! What every object store must do.

use case::ObjectKind;

use crate::label::Label;
use crate::objects::Objects;
use crate::{ObjectName, Spool, Unreadable, frame};

/// Objects do what they must. There are none at first.
pub(crate) async fn objects_do_what_they_must(objects: &Objects) {
    an_object_comes_back_and_goes(objects).await;
    a_damaged_object_is_told_and_written_over(objects).await;
    a_large_file_comes_back(objects).await;
}

async fn an_object_comes_back_and_goes(objects: &Objects) {
    let framed = frame(ObjectKind::Forest, vec![7; 5000].into());
    assert!(matches!(
        objects.get(&framed.name).await,
        Err(Unreadable::Missing)
    ));
    objects.put(&framed).await.unwrap();
    assert_eq!(objects.get(&framed.name).await.unwrap(), vec![7; 5000]);
    assert_eq!(objects.list().await.unwrap(), [framed.name]);
    objects.delete(&framed.name).await.unwrap();
    objects.delete(&framed.name).await.unwrap();
    assert!(matches!(
        objects.get(&framed.name).await,
        Err(Unreadable::Missing)
    ));
    assert_eq!(objects.label().await.unwrap(), Label::Missing);
}

async fn a_damaged_object_is_told_and_written_over(objects: &Objects) {
    let sound = frame(ObjectKind::Volume, (0..200).collect::<Vec<u8>>().into());
    objects.put(&sound).await.unwrap();
    let mut damaged = objects.get_framed(&sound.name).await.unwrap().to_vec();
    *damaged.last_mut().unwrap() ^= 1;
    objects
        .put_framed(&sound.name, damaged.into())
        .await
        .unwrap();
    assert!(matches!(
        objects.get(&sound.name).await,
        Err(Unreadable::Damaged(_))
    ));
    objects.put(&sound).await.unwrap();
    assert!(objects.get(&sound.name).await.is_ok());
}

async fn a_large_file_comes_back(objects: &Objects) {
    // Three parts, of which the last is short; with the header the second ends in the file's middle.
    for length in [0, 1, (16 << 20) - 72, 17_000_000] {
        let mut contents = vec![0; length];
        blake3::Hasher::new().finalize_xof().fill(&mut contents);
        let directory = tempfile::tempdir().unwrap();
        let mut spool = Spool::begin(directory.path().to_owned()).await.unwrap();
        spool.write(contents.clone().into()).await.unwrap();
        let file = spool.finish().await.unwrap();
        let name = ObjectName {
            kind: ObjectKind::SourceVolume,
            digest: *file.digest(),
        };
        assert_eq!(file.digest(), &blake3::hash(&contents));
        objects.put_file(&name, &file).await.unwrap();
        assert!(
            objects.get(&name).await.unwrap() == contents,
            "{length} bytes"
        );
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::testing::s3::{BUCKET, S3Server};

    #[tokio::test]
    async fn objects_in_memory_do_what_they_must() {
        let objects = Objects::new(Arc::new(object_store::memory::InMemory::new()));
        objects_do_what_they_must(&objects).await;
    }

    #[tokio::test]
    async fn objects_in_a_directory_do_what_they_must() {
        let directory = tempfile::tempdir().unwrap();
        let objects = Objects::in_directory(&directory.path().join("objects")).unwrap();
        objects_do_what_they_must(&objects).await;
    }

    #[tokio::test]
    async fn objects_in_a_bucket_do_what_they_must() {
        let Some(mut server) = S3Server::start().await else {
            return;
        };
        let mut variables = server
            .variables()
            .map(|(name, value)| (name.to_owned(), value));
        for prefix in ["", "a/b"] {
            let objects = Objects::in_bucket_with(BUCKET, prefix, &variables.clone().into());
            objects_do_what_they_must(&objects.unwrap()).await;
        }
        // The error about a missing store names no secret.
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(&file, crate::testing::s3::credentials("CANARY")).unwrap();
        variables[1].1 = file.path().to_str().unwrap().to_owned();
        let objects = Objects::in_bucket_with(BUCKET, "", &variables.into()).unwrap();
        let refused = objects.label().await.unwrap_err();
        assert!(
            !format!("{refused} {refused:?}").contains("CANARY"),
            "{refused:?}"
        );
        server.stop();
        let away = crate::StoreError::from(objects.label().await.unwrap_err());
        assert!(away.is_away(), "{away:?}");
    }
}
