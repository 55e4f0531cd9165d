//! Values of voxels as files, and the application on a store for one case.

use std::path::Path;

use case::{CaseId, VoxelValues};
use cases::settings::{GpuUse, Render};
use cases::{Cases, Error, Library, LibraryOptions, Preparation};
use storage::Store;

use super::status::CliError;
use super::{unwritable, write_output};
use crate::config::Config;

/// The application on a store for one case, whose maps are made on request if they are at all.
pub(super) fn on_store(store: Store, gpu: GpuUse, makes_maps: bool) -> Result<Cases, CliError> {
    let library_options = LibraryOptions {
        makes_maps,
        cache_bytes: u64::MAX,
        ..LibraryOptions::default()
    };
    let library = Library::new(store, Preparation::default(), library_options);
    let options = cases::Options {
        render: Render {
            gpu,
            ..Render::default()
        },
        ..Config::default().cases()?
    };
    Ok(Cases::on(library, &options))
}

/// Writes each file of voxels that a case has, and reports those that it does not have.
pub(super) async fn write_voxels(store: Store, id: &CaseId, folder: &Path) -> Result<(), CliError> {
    std::fs::create_dir_all(folder).map_err(|error| unwritable(folder, &error))?;
    let cases = on_store(store, GpuUse::Off, true)?;
    cases.library.make_maps_now(id).await?;
    for values in VoxelValues::ALL {
        let name = values.name();
        let path = folder.join(format!("{name}.nii.gz"));
        match cases.nifti(id, values).await {
            Ok(file) => write_output(&path, &file.bytes)?,
            Err(Error::MapsUndefined(reason)) => {
                eprintln!("isocortex: no {name}: {reason}");
                if path.exists() {
                    let path = path.display();
                    eprintln!("isocortex: {path} was there before, and is not of this head");
                }
            }
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}
