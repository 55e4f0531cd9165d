//! Finds cases by what they are and whose they are.

use case::series::CaseSeries;
use storage::tables::series;
use storage::{CaseQuery, Cursor, Listed, StoreError};

use crate::application::Cases;
use crate::patient::Patient;

/// A case that a search has found, and whose it is if that was asked for.
#[derive(Debug)]
pub struct Found {
    pub listed: Listed,
    /// The series that it was made of, if it was DICOM.
    pub series: Option<CaseSeries>,
    /// The patient, if the series states one.
    pub patient: Option<Patient>,
}

/// A page of the cases that a search has found.
#[derive(Debug)]
pub struct FoundPage {
    pub cases: Vec<Found>,
    /// The start of the next page, newest first.
    pub next: Option<Cursor>,
    /// How many cases there are, if some were passed over.
    pub total: Option<u64>,
}

impl Cases {
    /// At most `limit` cases of a search, after a cursor if they are listed newest first.
    ///
    /// # Errors
    /// If the store cannot be read.
    pub async fn search(
        &self,
        query: &CaseQuery,
        after: Option<&Cursor>,
        limit: usize,
        shows_patients: bool,
    ) -> Result<FoundPage, StoreError> {
        let page = self.store().cases(query, after, limit).await?;
        let mut cases = Vec::with_capacity(page.cases.len());
        for listed in page.cases {
            cases.push(match shows_patients {
                true => self.with_patient(listed).await?,
                false => Found {
                    listed,
                    series: None,
                    patient: None,
                },
            });
        }
        Ok(FoundPage {
            cases,
            next: page.next,
            total: page.total,
        })
    }

    async fn with_patient(&self, listed: Listed) -> Result<Found, StoreError> {
        let id = &listed.case.id;
        let series = series::of_case(&mut self.store().connect().await?, id).await?;
        let attributes = match series {
            Some(_) => self.attributes_of(id).await?,
            None => None,
        };
        Ok(Found {
            listed,
            series,
            patient: attributes.map(|source| Patient::of(|keyword| source.value(keyword))),
        })
    }
}
