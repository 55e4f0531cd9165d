//! Encrypts the objects of a store with its current key, or decrypts them if there is none.

use futures_util::{StreamExt as _, stream};

use super::{KeyId, ObjectName, REMOVALS_AT_ONCE, Store, StoreError, Unreadable};

/// Objects to look at at a time.
const AT_ONCE: usize = 8;

/// The result of a change of keys.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Rekeyed {
    /// The key of all objects; `None` if they are not encrypted.
    pub key: Option<KeyId>,
    /// Objects written.
    pub written: u64,
    /// Objects that were as they should be.
    pub kept: u64,
    /// Objects that are damaged, and stay as they are.
    pub damaged: Vec<ObjectName>,
    /// Keys that no object needs any more.
    pub retired: Vec<KeyId>,
}

impl Store {
    /// Writes every object that is not encrypted with the key for new objects again. The store may be in use. An interrupted
    /// change is continued by the next one.
    ///
    /// # Errors
    /// If the store cannot be reached, or a key is missing.
    pub async fn rekey(
        &self,
        report: &mut (dyn FnMut(&Rekeyed) + Send),
    ) -> Result<Rekeyed, StoreError> {
        let key = self.objects().keys().current();
        let mut rekeyed = Rekeyed {
            key,
            ..Rekeyed::default()
        };
        loop {
            let written = rekeyed.written;
            (rekeyed.kept, rekeyed.damaged) = (0, Vec::new());
            for some in self.objects().list().await?.chunks(REMOVALS_AT_ONCE) {
                self.rekey_some(some, &mut rekeyed).await?;
                report(&rekeyed);
            }
            // Other processes may have written objects with the key of before meanwhile.
            if rekeyed.written == written {
                break;
            }
        }
        rekeyed.kept = rekeyed.kept.saturating_sub(rekeyed.written);
        if rekeyed.damaged.is_empty() {
            for other in self.objects().named_keys().await? {
                if Some(other) != key {
                    self.objects().forget_key(other).await?;
                    rekeyed.retired.push(other);
                }
            }
        }
        Ok(rekeyed)
    }

    pub(crate) async fn rekey_some(
        &self,
        names: &[ObjectName],
        rekeyed: &mut Rekeyed,
    ) -> Result<(), StoreError> {
        let wanted = Some(rekeyed.key);
        let looks: Vec<_> = names
            .iter()
            .map(|name| async move {
                let is_so = self.objects().key_of(name).await == wanted;
                (!is_so).then_some(*name)
            })
            .collect();
        let looked: Vec<_> = stream::iter(looks)
            .buffer_unordered(AT_ONCE)
            .collect()
            .await;
        let stale: Vec<ObjectName> = looked.into_iter().flatten().collect();
        rekeyed.kept += (names.len() - stale.len()) as u64;
        if stale.is_empty() {
            return Ok(());
        }
        // Nobody removes them between reading and writing.
        let pinned = self.pin(stale.iter().copied()).await?;
        let mut result = Ok(());
        for name in stale {
            match self.rewrite(&name).await {
                Ok(()) => rekeyed.written += 1,
                Err(Unreadable::Damaged(_)) => rekeyed.damaged.push(name),
                // It was removed a moment ago.
                Err(Unreadable::Missing) => {}
                Err(Unreadable::Store(error)) => {
                    result = Err(error.into());
                    break;
                }
            }
        }
        self.abandon(&pinned).await;
        result
    }

    async fn rewrite(&self, name: &ObjectName) -> Result<(), Unreadable> {
        let framed = self.objects().get_framed(name).await?;
        Ok(self.objects().put_framed(name, framed).await?)
    }
}
