//! Takes over images from a PACS: durable, and referred to, before they are acknowledged.

use std::collections::HashMap;

use futures_util::StreamExt as _;
use futures_util::stream;

use super::arrivals::{ArrivalSource, NewInstance, Received};
use super::{ImageStatus, ObjectName, Spooled, Store, StoreError};

/// Objects that are written at a time.
const WRITES_AT_ONCE: usize = 8;

/// How often to pin again after a pin is lost.
const PIN_ATTEMPTS: usize = 3;

impl Store {
    /// Adds images with their files to their series. Afterwards they are durable. The operation completes even if the
    /// caller drops the future.
    ///
    /// # Errors
    /// If the rows or the objects cannot be written. Nothing is acknowledged then, and nothing is left behind.
    pub async fn receive(
        &self,
        images: Vec<(NewInstance, Spooled)>,
        source: ArrivalSource,
    ) -> Result<Received, StoreError> {
        let (store, count) = (self.clone(), images.len());
        let corrections = images.iter().filter(|(new, _)| new.replaces.is_some());
        let corrected = corrections.count();
        let received = tokio::spawn(async move { store.receive_now(&images, source).await });
        let received = received.await?;
        let signals = self.signals();
        match &received {
            Ok(Received { new, .. }) => {
                signals.images_came(source, ImageStatus::Stored, *new);
                signals.images_came(source, ImageStatus::Corrected, corrected);
                let known = count.saturating_sub(*new + corrected);
                signals.images_came(source, ImageStatus::Known, known);
            }
            Err(_) => signals.images_came(source, ImageStatus::Failed, count),
        }
        received
    }

    async fn receive_now(
        &self,
        images: &[(NewInstance, Spooled)],
        source: ArrivalSource,
    ) -> Result<Received, StoreError> {
        let files: HashMap<ObjectName, &Spooled> = images
            .iter()
            .map(|(instance, file)| (ObjectName::from(instance), file))
            .collect();
        let instances: Vec<NewInstance> = images.iter().map(|(new, _)| new.clone()).collect();
        for _ in 0..PIN_ATTEMPTS {
            let pinned = self.pin(files.keys().copied()).await?;
            if let Err(error) = self.write_files(&files).await {
                self.abandon(&pinned).await;
                return Err(error);
            }
            let received = self.insert_images(&instances, &pinned, source).await;
            match received {
                Ok(Some(received)) if received.new < instances.len() => {
                    // Files of images that were there already, or that were replaced, are not needed.
                    if let Err(error) = self.collect().await {
                        tracing::warn!(%error, "abandoned objects will be removed later");
                    }
                    return Ok(received);
                }
                Ok(Some(received)) => return Ok(received),
                Ok(None) => self.abandon(&pinned).await,
                Err(error) => {
                    self.abandon(&pinned).await;
                    return Err(error);
                }
            }
        }
        Err(StoreError::Rows(
            "an object was removed repeatedly while it was written".into(),
        ))
    }

    async fn write_files(&self, files: &HashMap<ObjectName, &Spooled>) -> Result<(), StoreError> {
        let writes: Vec<_> = files
            .iter()
            .map(|(name, file)| self.objects().put_file(name, file))
            .collect();
        let mut writes = stream::iter(writes).buffer_unordered(WRITES_AT_ONCE);
        while let Some(written) = writes.next().await {
            written?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arrivals::{SeriesQuery, SeriesUids, Uid};
    use crate::testing::files_below;

    fn uid(text: &str) -> Uid {
        Uid::parse(text).unwrap()
    }

    async fn image(store: &Store, number: u32, contents: &str) -> (NewInstance, Spooled) {
        let file = store.spool_all(contents.to_owned().into()).await.unwrap();
        let new = NewInstance {
            uids: SeriesUids {
                study: uid("1.2"),
                series: uid("1.2.3"),
            },
            accession_number: None,
            sop_instance_uid: uid(&format!("1.2.3.{number}")),
            digest: *file.digest(),
            label: None,
            replaces: None,
        };
        (new, file)
    }

    #[tokio::test]
    async fn images_are_durable_and_what_is_sent_twice_is_there_once() {
        let directory = tempfile::tempdir().unwrap();
        let store = Store::open(directory.path()).await.unwrap();
        let images = vec![image(&store, 1, "one").await, image(&store, 2, "two").await];
        let source = ArrivalSource::CStore;
        assert_eq!(store.receive(images, source).await.unwrap().new, 2);
        let again = vec![
            image(&store, 1, "one").await,
            image(&store, 1, "another").await,
            image(&store, 3, "two").await,
        ];
        assert_eq!(store.receive(again, source).await.unwrap().new, 1);
        let objects = directory.path().join("objects");
        assert_eq!(
            files_below(&objects).len(),
            2,
            "the other contents are gone"
        );
        assert_eq!(files_below(&directory.path().join("uploads")).len(), 0);
        store.close().await;
        let store = Store::open(directory.path()).await.unwrap();
        let query = SeriesQuery::Study(uid("1.2"), None);
        let arrivals = store.arrivals_of(&query).await.unwrap();
        assert_eq!(arrivals[0].instances, 3);
        assert_eq!(files_below(&objects).len(), 2);
    }
}
