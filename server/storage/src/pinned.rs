//! The one way in which objects become durable and are referred to: pin, write, refer in a transaction; again if a pin was
//! lost.

use std::time::{Duration, Instant};

use futures_util::{StreamExt as _, TryStreamExt as _, stream};

use crate::rows::{Pinned, Referred};
use crate::{Framed, ObjectName, Spooled, Store, StoreError};

/// How often to begin again if a pin is lost.
const ATTEMPTS: usize = 16;

/// Objects that are written at a time.
const WRITES_AT_ONCE: usize = 8;

/// The lifetime of a pin: an object must be written within this time.
const PIN_FOR: Duration = Duration::from_secs(3600);

/// How long to wait for an object that is being removed: longer than the lease of a killed sweep.
const REMOVAL_PATIENCE: Duration = Duration::from_secs(90);

/// How often to check whether it is gone.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// An object to be written.
#[derive(Debug, Clone, Copy)]
pub enum Writing<'a> {
    /// A spooled file.
    File(ObjectName, &'a Spooled),
    /// A derived object.
    Framed(&'a Framed),
    /// It is there already; whoever refers to it checks that something else does.
    Stored(ObjectName),
}

impl Writing<'_> {
    pub(crate) fn name(&self) -> ObjectName {
        match self {
            Self::File(name, _) | Self::Stored(name) => *name,
            Self::Framed(framed) => framed.name,
        }
    }
}

impl Pinned {
    /// Objects to be pinned by a holder of their own.
    pub fn new(names: impl IntoIterator<Item = ObjectName>) -> Self {
        Self {
            holder: unique_holder(),
            names: names.into_iter().collect(),
        }
    }
}

impl Store {
    /// Makes objects durable, then refers to them in the transaction of `refer`. Leaves nothing behind if that fails or
    /// does not need them.
    ///
    /// # Errors
    /// That of `refer`, or if the objects cannot be written.
    pub async fn with_pinned<T, F>(
        &self,
        objects: &[Writing<'_>],
        refer: impl Fn(Pinned) -> F,
    ) -> Result<T, StoreError>
    where
        F: Future<Output = Result<Referred<T>, StoreError>>,
    {
        for _ in 0..ATTEMPTS {
            let pinned = self.pin(objects.iter().map(Writing::name)).await?;
            let referred = match self.write_all(objects).await {
                Ok(()) => refer(pinned.clone()).await,
                Err(error) => Err(error),
            };
            if let Ok(Referred::Done(value)) = referred {
                return Ok(value);
            }
            self.abandon(&pinned).await;
            if let Referred::Unneeded(value) = referred? {
                return Ok(value);
            }
        }
        Err(StoreError::Rows(
            "an object was removed repeatedly while it was written".into(),
        ))
    }

    async fn write_all(&self, objects: &[Writing<'_>]) -> Result<(), StoreError> {
        let writes: Vec<_> = objects
            .iter()
            .map(|object| self.write_object(object))
            .collect();
        let writes = stream::iter(writes).buffer_unordered(WRITES_AT_ONCE);
        writes.try_collect().await
    }

    async fn write_object(&self, object: &Writing<'_>) -> Result<(), StoreError> {
        match object {
            Writing::File(name, file) => self.objects().put_file(name, file).await?,
            Writing::Framed(framed) => self.objects().put(framed).await?,
            Writing::Stored(_) => {}
        }
        Ok(())
    }

    /// Pins objects before they are written. Waits for objects that are being removed.
    pub(crate) async fn pin(
        &self,
        names: impl IntoIterator<Item = ObjectName>,
    ) -> Result<Pinned, StoreError> {
        let pinned = Pinned::new(names);
        self.id().await?;
        let begun = Instant::now();
        while !self.try_pin(&pinned, PIN_FOR).await? {
            if begun.elapsed() > REMOVAL_PATIENCE {
                return Err(StoreError::Objects(
                    "the removal of an object takes too long".into(),
                ));
            }
            tokio::time::sleep(LOOK_EVERY).await;
            // If its remover was killed, only this process may finish the removal.
            self.collect().await?;
        }
        Ok(pinned)
    }

    /// Abandons pinned objects. If this fails, they are removed after their pins expire.
    pub(crate) async fn abandon(&self, pinned: &Pinned) {
        let unpinned = self.unpin(pinned).await;
        let collected = match unpinned {
            Ok(()) => self.collect().await,
            Err(error) => Err(error),
        };
        if let Err(error) = collected {
            tracing::warn!(%error, "abandoned objects will be removed later");
        }
    }
}

/// A name for the holder of pins or tombstones, unique across all processes.
pub(crate) fn unique_holder() -> String {
    uuid::Uuid::now_v7().to_string()
}
