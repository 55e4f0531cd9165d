//! Takes over images from a PACS: durable, and referred to, before they are acknowledged.

use std::collections::HashMap;

use storage::Pinned;
use storage::tables::Writing;
use storage::{ObjectName, Spooled, StoreError};

use super::{ImageStatus, PacsStore};
use crate::values::{ArrivalSource, NewInstance, Reception};

impl PacsStore {
    /// Adds images with their files to their series, and returns what became of each. Afterwards they are durable. The operation completes
    /// even if the caller drops the future.
    ///
    /// # Errors
    /// If the rows or the objects cannot be written. Nothing is acknowledged then, and nothing is left behind.
    pub(crate) async fn receive(
        &self,
        images: Vec<(NewInstance, Spooled)>,
        source: ArrivalSource,
    ) -> Result<Vec<Reception>, StoreError> {
        let (store, count) = (self.clone(), images.len());
        let received = tokio::spawn(async move { store.receive_now(&images, source).await });
        let received = received.await?;
        match &received {
            Ok(receptions) => {
                for (reception, status) in [
                    (Reception::New, ImageStatus::Stored),
                    (Reception::Corrected, ImageStatus::Corrected),
                    (Reception::Known, ImageStatus::Known),
                ] {
                    let of_status = receptions.iter().filter(|became| **became == reception);
                    self.images_came(source, status, of_status.count());
                }
                if receptions.contains(&Reception::Corrected) {
                    tracing::warn!(
                        "images that are known have come with other contents, which count from now on"
                    );
                }
            }
            Err(_) => self.images_came(source, ImageStatus::Failed, count),
        }
        received
    }

    async fn receive_now(
        &self,
        images: &[(NewInstance, Spooled)],
        source: ArrivalSource,
    ) -> Result<Vec<Reception>, StoreError> {
        let files: HashMap<ObjectName, &Spooled> = images
            .iter()
            .map(|(instance, file)| (ObjectName::from(instance), file))
            .collect();
        let files = files.into_iter();
        let files: Vec<_> = files
            .map(|(name, file)| Writing::File(name, file))
            .collect();
        let instances: Vec<NewInstance> = images.iter().map(|(new, _)| new.clone()).collect();
        let some = &instances[..];
        let insert =
            |pinned: Pinned| async move { self.insert_images(some, &pinned, source).await };
        let received = self.store.with_pinned(&files, insert).await?;
        // Files of images that were there already, or that were replaced, are not needed.
        if received.iter().any(|became| *became != Reception::New)
            && let Err(error) = self.store.collect().await
        {
            tracing::warn!(%error, "abandoned objects will be removed later");
        }
        Ok(received)
    }
}

#[cfg(test)]
mod tests {
    use case::series::{SeriesQuery, SeriesUids, Uid};
    use storage::testing::{files_below, objects_below};

    use super::*;
    use crate::store::conformance::open;

    fn uid(text: &str) -> Uid {
        Uid::parse(text).unwrap()
    }

    async fn image(store: &PacsStore, number: u32, contents: &str) -> (NewInstance, Spooled) {
        let file = store
            .store()
            .spools()
            .of(contents.to_owned().into())
            .await
            .unwrap();
        let new = NewInstance {
            uids: SeriesUids {
                study: uid("1.2"),
                series: uid("1.2.3"),
            },
            accession_number: None,
            sop_instance_uid: uid(&format!("1.2.3.{number}")),
            digest: *file.digest(),
            label: None,
            fingerprint: None,
        };
        (new, file)
    }

    #[tokio::test]
    async fn images_are_durable_and_what_is_sent_twice_is_there_once() {
        let directory = tempfile::tempdir().unwrap();
        let store = open(directory.path()).await;
        let images = vec![image(&store, 1, "one").await, image(&store, 2, "two").await];
        let source = ArrivalSource::CStore;
        let received = store.receive(images, source).await.unwrap();
        assert_eq!(received, [Reception::New; 2]);
        let again = vec![
            image(&store, 1, "one").await,
            image(&store, 1, "another").await,
            image(&store, 3, "two").await,
        ];
        let received = store.receive(again, source).await.unwrap();
        assert_eq!(
            received,
            [Reception::Known, Reception::Known, Reception::New]
        );
        let objects = directory.path().join("objects");
        assert_eq!(
            objects_below(&objects).len(),
            2,
            "the other contents are gone"
        );
        assert_eq!(files_below(&directory.path().join("uploads")).len(), 0);
        store.store().close().await;
        let store = open(directory.path()).await;
        let query = SeriesQuery::Study(uid("1.2"), None);
        let arrivals = store.arrivals_of(&query).await.unwrap();
        assert_eq!(arrivals[0].instances, 3);
        assert_eq!(objects_below(&objects).len(), 2);
    }
}
