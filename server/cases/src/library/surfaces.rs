//! The surfaces of parts of a brain: computed with the maps, or else when one is first shown, and stored as one object of its case.

use std::time::Instant;

use bytes::Bytes;
use case::{CaseFacts, CaseId, ObjectKind, SurfaceName};
use geometry::{DeformableModel, DistanceMap, Envelope, GeometryError};
use pipeline::codec::{decode_brain, decode_surfaces, decode_volume, encode_surfaces};
use pipeline::surfaces::{
    DividedCase, SurfacesOrReason, compute_surfaces, surface_facts, surface_model, with_cuts_of,
};
use pipeline::{Undefined, envelope_of};
use storage::{Publisher, StoreError, frame_all};

use super::Library;

impl Library {
    /// The closed part of a surface of a ready case, with the cuts of its volume; `None` if there is no such case. The parts are
    /// computed now, unless they are stored.
    ///
    /// # Errors
    /// If the store cannot be reached.
    ///
    /// # Panics
    /// For the whole brain, whose envelope is an object of its own.
    pub(crate) async fn surface_envelope(
        &self,
        id: &CaseId,
        name: SurfaceName,
    ) -> Result<Option<Result<Envelope, Undefined>>, StoreError> {
        let Some(surfaces) = self.surfaces(id).await? else {
            return Ok(None);
        };
        let Some(facts) = self.store().case(id).await?.and_then(|case| case.facts) else {
            return Ok(None);
        };
        Ok(Some(surfaces.map(|surfaces| {
            let envelope = surfaces.into_envelope(name);
            with_cuts_of(&facts, envelope.expect("not the whole brain"))
        })))
    }

    /// The model of a surface of a ready case and its facts, as [`Library::surface_envelope`].
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub(crate) async fn surface_model(
        &self,
        id: &CaseId,
        name: SurfaceName,
    ) -> Result<Option<Result<(DeformableModel, CaseFacts), Undefined>>, StoreError> {
        let envelope = match self.surface_envelope(id, name).await? {
            None => return Ok(None),
            Some(Err(reason)) => return Ok(Some(Err(reason))),
            Some(Ok(envelope)) => envelope,
        };
        let build = move |facts: &CaseFacts, payloads: &[Bytes]| {
            let volume = decode_volume(payloads.first()?)?;
            let built = surface_model(&volume, envelope.clone(), name);
            Some(built.map(|built| {
                let facts = surface_facts(facts, &built);
                // Now, not in the first picture.
                built.model.normals();
                (built.model, facts)
            }))
        };
        let built = self.load(id, &[ObjectKind::Volume], build).await?;
        Ok(built.map(|built| built.map_err(|error: GeometryError| error.into())))
    }

    /// The distance map of a surface, as [`Library::surface_envelope`].
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub(crate) async fn surface_distance(
        &self,
        id: &CaseId,
        name: SurfaceName,
    ) -> Result<Option<DistanceMap>, StoreError> {
        let Some(Ok(envelope)) = self.surface_envelope(id, name).await? else {
            return Ok(None);
        };
        let map = move || geometry::distance_map(&envelope);
        Ok(Some(tokio::task::spawn_blocking(map).await?))
    }

    async fn surfaces(&self, id: &CaseId) -> Result<Option<SurfacesOrReason>, StoreError> {
        if let Some(found) = self.read_surfaces(id).await? {
            return Ok(Some(found));
        }
        let _one_at_a_time = self.inner.dividing.lock().await;
        // Another caller may have done it meanwhile.
        if let Some(found) = self.read_surfaces(id).await? {
            return Ok(Some(found));
        }
        self.make_surfaces(id).await
    }

    /// Computes the surfaces of a case and stores them; `None` if the case is gone.
    async fn make_surfaces(&self, id: &CaseId) -> Result<Option<SurfacesOrReason>, StoreError> {
        const KINDS: &[ObjectKind] = &[ObjectKind::Mask, ObjectKind::Envelope, ObjectKind::Volume];
        let begun = Instant::now();
        let Some(case) = self.store().case(id).await? else {
            return Ok(None);
        };
        let compute = move |facts: &CaseFacts, payloads: &[Bytes]| {
            let [brain, envelope, volume] = payloads else {
                return None;
            };
            let surfaces = compute_surfaces(DividedCase {
                facts,
                parameters: &case.parameters,
                brain: &decode_brain(brain)?,
                envelope: &envelope_of(facts, envelope)?,
                volume: &decode_volume(volume)?,
            });
            Some((encode_surfaces(&surfaces), surfaces))
        };
        let Some((payload, surfaces)) = self.load(id, KINDS, compute).await? else {
            return Ok(None);
        };
        let framed = frame_all(vec![(ObjectKind::Surfaces, payload.into())]).await?;
        let publisher = Publisher::Ready(id.into());
        self.store().publish(publisher, framed).await?;
        let took_ms = u64::try_from(begun.elapsed().as_millis()).unwrap_or(u64::MAX);
        tracing::info!(
            took_ms,
            undefined = surfaces.as_ref().err().map(|reason| &*reason.code),
            "computed the surfaces of a case"
        );
        Ok(Some(surfaces))
    }

    /// The stored surfaces of a case; `None` if they are missing, damaged or of another format.
    async fn read_surfaces(&self, id: &CaseId) -> Result<Option<SurfacesOrReason>, StoreError> {
        let names = self.store().objects_of(id).await?;
        let read = self.store().read(id, &names, ObjectKind::Surfaces).await?;
        let Some(payload) = read else {
            return Ok(None);
        };
        let decode = move || decode_surfaces(&payload);
        Ok(tokio::task::spawn_blocking(decode).await?)
    }
}
