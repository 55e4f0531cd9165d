//! Finds cases by what they are and whose they are.

use case::Case;
use case::series::CaseSeries;
use storage::tables::series;
use storage::{CaseQuery, Cursor, StoreError};

use crate::application::Cases;
use crate::patient::Patient;

/// A case that a search has found. It shows a patient.
#[derive(Debug)]
pub struct Found {
    pub case: Case,
    /// The series that it was made of, if it was DICOM.
    pub series: Option<CaseSeries>,
    /// The patient, if the series states one.
    pub patient: Option<Patient>,
}

impl Cases {
    /// At most `limit` cases of a search after a cursor, newest first, and the cursor of the next page.
    ///
    /// # Errors
    /// If the store cannot be read.
    pub async fn search(
        &self,
        query: &CaseQuery,
        after: Option<&Cursor>,
        limit: usize,
    ) -> Result<(Vec<Found>, Option<Cursor>), StoreError> {
        let page = self.store().cases(query, after, limit).await?;
        let mut found = Vec::with_capacity(page.cases.len());
        for case in page.cases {
            let series = series::of_case(&mut self.store().connect().await?, &case.id).await?;
            let attributes = match series {
                Some(_) => self.attributes_of(&case.id).await?,
                None => None,
            };
            found.push(Found {
                case,
                series,
                patient: attributes.map(|source| Patient::of(|keyword| source.value(keyword))),
            });
        }
        Ok((found, page.next))
    }
}
