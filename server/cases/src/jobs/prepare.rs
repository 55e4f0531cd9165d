use std::sync::atomic::AtomicBool;

use async_trait::async_trait;
use case::{Case, Failure, FailureKind, JobKind, Progress, Stage};
use pipeline::Derived;
use storage::{Count, Published, Publisher, StoreError, frame_all};

use super::headers::contradicts_header;
use super::usual_terms;
use crate::library::Library;
use crate::runner::{End, Failed, Running, Terms, Work};

pub(super) struct PrepareCase(pub(super) Library);

#[async_trait]
impl Work for PrepareCase {
    fn kind(&self) -> JobKind {
        JobKind::PREPARE
    }

    fn terms(&self) -> Terms {
        usual_terms(&self.0)
    }

    async fn run(&self, job: &Running) -> Result<End, Failed> {
        let store = self.0.store();
        let Some(id) = job.claim.case else {
            return Ok(End::Settled);
        };
        let Some(case) = store.case(&id).await? else {
            return Ok(End::Settled);
        };
        let mut derived = self.derive(job, case).await?;
        let is_doubtful = contradicts_header(store, &id, &derived.facts).await?;
        if let Some(quality) = derived.facts.quality.as_mut() {
            quality.set_axes_corrected(is_doubtful);
        }
        let storing = Progress::at(Stage::Storing);
        job.report(&storing);
        store.signals().progress(&id, Some(storing));
        let framed = frame_all(derived.objects).await?;
        let next: &'static [JobKind] = match self.0.makes_maps() {
            true => &[JobKind::MAPS],
            false => &[],
        };
        let publisher = Publisher::Case(job.claim.clone(), Box::new(derived.facts.clone()), next);
        match store.publish(publisher, framed).await? {
            Published::Done => {
                store.signals().count(Count::Prepared);
                tracing::info!(job = job.claim.fence, case = id.short(), "a case is ready");
                // Another one may have become ready meanwhile.
                if contradicts_header(store, &id, &derived.facts).await? {
                    store.doubt_axes(&id).await?;
                }
            }
            Published::Fenced => tracing::info!(
                job = job.claim.fence,
                case = id.short(),
                "a preparation finished after its lease had ended and was discarded"
            ),
        }
        Ok(End::Settled)
    }
}

impl PrepareCase {
    /// What a preparation makes of the sources, on a blocking thread; nothing is stored yet.
    async fn derive(&self, job: &Running, case: Case) -> Result<Derived, Failed> {
        let (library, id) = (&self.0, case.id);
        let mut names = library.store().objects_of(&id).await?;
        names.retain(|name| name.kind.is_source());
        let source = library.source(&id, &names).await?;
        let source = source.ok_or_else(|| Failed::Forever(Failure::source_damaged()))?;
        let (report, is_cancelled) = (job.reporter(), job.is_cancelled());
        let memory = library.memory_to_prepare().await;
        let library = library.clone();
        let derive = move || {
            // Also if nobody waits any more.
            let _until_done = memory;
            let observe = |now: Progress| {
                report(&now);
                library.store().signals().progress(&id, Some(now));
            };
            let cancelled: &AtomicBool = &is_cancelled;
            library.prepare(&source, &case.parameters, &observe, cancelled)
        };
        match tokio::task::spawn_blocking(derive).await {
            Ok(derived) => derived.map_err(|failure| match failure.kind {
                FailureKind::Cancelled => Failed::ForNow(failure),
                _ => Failed::Forever(failure),
            }),
            // The same input would cause the same internal error again.
            Err(error) if error.is_panic() => Err(Failed::Forever(Failure::new(
                FailureKind::Internal,
                "preparation-crashed",
                "internal error during the preparation",
            ))),
            Err(error) => Err(StoreError::from(error).into()),
        }
    }
}
