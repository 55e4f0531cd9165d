//! What encryption costs when a case is read: one store and its encrypted copy, read in turn. Prints medians and ratios.
//!
//! ```sh
//! isocortex prepare VOLUME --data plain && isocortex key new --file keys
//! isocortex migrate-store --from plain --to sealed --key-file keys
//! cargo run --release -p isocortex-bench --example encryption -- plain sealed keys [ROUNDS]
//! ```

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use bytes::Bytes;
use case::{CaseFacts, CaseId, ObjectKind};
use geometry::{DeformableModel, DepthMaps};
use pipeline::codec::{decode_paths, decode_volume};
use pipeline::envelope_of;
use storage::{Attempt, Keys, Location, ObjectName, Options, Store};

type Failure = Box<dyn std::error::Error>;

/// What a picture needs of a case.
const KINDS: &[ObjectKind] = &[ObjectKind::Envelope, ObjectKind::Volume, ObjectKind::Paths];

/// The model of a case, as the server makes it.
fn decode(facts: &CaseFacts, payloads: &[Bytes]) -> Option<DeformableModel> {
    let [envelope, volume, paths] = payloads else {
        return None;
    };
    let default_paths = decode_paths(paths)?;
    let depth = DepthMaps::new(&geometry::distance_map(&envelope_of(facts, envelope)?));
    depth.normals();
    Some(DeformableModel::new(
        decode_volume(volume)?,
        depth,
        default_paths,
    ))
}

/// A store with one case.
struct Subject {
    store: Store,
    id: CaseId,
    names: Vec<ObjectName>,
}

impl Subject {
    async fn open(folder: &str, keys: Keys) -> Result<Self, Failure> {
        let location = Location {
            keys,
            ..Location::from(Path::new(folder))
        };
        let store = Store::open_at(&location, Options::default()).await?;
        let case = store.cases(None, 1).await?.cases.pop();
        let id = case.ok_or("the store has no case")?.id;
        let names = store.case_objects(&id).await?;
        Ok(Self { store, id, names })
    }

    /// Seconds until the model is there.
    async fn model(&self) -> Result<f64, Failure> {
        let begun = Instant::now();
        match self
            .store
            .read_derived(&self.id, KINDS, &Arc::new(decode))
            .await?
        {
            Attempt::Read(_) => Ok(begun.elapsed().as_secs_f64()),
            other => Err(format!("{other:?}").into()),
        }
    }

    /// Seconds until every object was read, verified and unpacked, and their bytes.
    async fn objects(&self) -> Result<(f64, usize), Failure> {
        let begun = Instant::now();
        let mut bytes = 0;
        for name in &self.names {
            bytes += self.store.object(name).await?.len();
        }
        Ok((begun.elapsed().as_secs_f64(), bytes))
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[tokio::main]
async fn main() -> Result<(), Failure> {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    let [plain, sealed, keys, rest @ ..] = &arguments[..] else {
        return Err("arguments: PLAIN SEALED KEYS [ROUNDS]".into());
    };
    let rounds = rest.first().map_or(Ok(51), |rounds| rounds.parse())?;
    let plain = Subject::open(plain, Keys::default()).await?;
    let sealed = Subject::open(sealed, Keys::read(Path::new(keys))?).await?;
    let mut models = [Vec::new(), Vec::new()];
    let mut objects = [Vec::new(), Vec::new()];
    let mut bytes = 0;
    for _ in 0..=rounds {
        for (which, subject) in [&plain, &sealed].into_iter().enumerate() {
            models[which].push(subject.model().await?);
            let (seconds, read) = subject.objects().await?;
            objects[which].push(seconds);
            bytes = read;
        }
    }
    println!("{rounds} rounds, in turn; {bytes} bytes in all objects, unpacked");
    for (what, times) in [("a model", models), ("every object of the case", objects)] {
        // The first of each is not warm.
        let [plain, sealed] = times.map(|times| median(times[1..].to_vec()) * 1e3);
        println!(
            "{what}: {plain:.2} ms, encrypted {sealed:.2} ms, ratio {:.3}",
            sealed / plain
        );
    }
    Ok(())
}
