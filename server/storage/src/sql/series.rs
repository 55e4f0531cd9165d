//! The series that cases were made of, for requests that name one.

use case::CaseId;
use case::series::{AccessionNumber, CaseSeries, PatientDigest, SeriesQuery, SeriesUids, Uid};

use super::connection::{Connection, Row, unreadable};
use super::made::read_uid;
use crate::StoreError;
use crate::args;

/// Enters a case under its series, unless it is there; nothing if there is no such case.
pub async fn index(
    connection: &mut Connection,
    case: &CaseId,
    series: &CaseSeries,
) -> Result<(), StoreError> {
    let number = series.accession_number.as_ref();
    connection
        .execute(
            "INSERT INTO case_series (case_id, study_uid, series_uid, accession_number, patient)
             SELECT id, $2, $3, $4, $5 FROM cases WHERE id = $1
             ON CONFLICT (case_id) DO NOTHING",
            args![
                case.to_string(),
                series.uids.study.as_str(),
                series.uids.series.as_str(),
                number.map(AccessionNumber::as_str),
                series.patient.map(PatientDigest::to_hex)
            ],
        )
        .await?;
    Ok(())
}

/// Enters a version under the series of its case.
pub(super) async fn inherit(
    connection: &mut Connection,
    case: &CaseId,
    previous: &CaseId,
) -> Result<(), StoreError> {
    match of_case(connection, previous).await? {
        Some(series) => index(connection, case, &series).await,
        None => Ok(()),
    }
}

/// The indexed series of a case.
pub async fn of_case(
    connection: &mut Connection,
    case: &CaseId,
) -> Result<Option<CaseSeries>, StoreError> {
    let row = connection
        .fetch_optional(
            "SELECT study_uid, series_uid, accession_number, patient FROM case_series WHERE case_id = $1",
            args![case.to_string()],
        )
        .await?;
    row.as_ref().map(read_case_series).transpose()
}

/// The cases that a request names, newest first.
pub async fn cases_of(
    connection: &mut Connection,
    query: &SeriesQuery,
) -> Result<Vec<(CaseId, CaseSeries)>, StoreError> {
    let rows = match query {
        SeriesQuery::Study(study, series) => connection.fetch_all(
            "SELECT case_id, study_uid, series_uid, accession_number, patient
                 FROM case_series JOIN cases ON cases.id = case_series.case_id
                 WHERE study_uid = $1 AND coalesce($2, series_uid) = series_uid
                 ORDER BY created_at DESC, id",
            args![study.as_str(), series.as_ref().map(Uid::as_str)],
        ),
        SeriesQuery::AccessionNumber(number) => connection.fetch_all(
            "SELECT case_id, study_uid, series_uid, accession_number, patient
                 FROM case_series JOIN cases ON cases.id = case_series.case_id
                 WHERE accession_number = $1
                 ORDER BY created_at DESC, id",
            args![number.as_str()],
        ),
    };
    let read = |row: &Row| {
        let case = read_case(row, "case_id")?.ok_or_else(|| unreadable("a case"))?;
        Ok((case, read_case_series(row)?))
    };
    rows.await?.iter().map(read).collect()
}

fn read_case_series(row: &Row) -> Result<CaseSeries, StoreError> {
    Ok(CaseSeries {
        uids: read_uids(row)?,
        accession_number: read_accession_number(row)?,
        patient: read_patient(row)?,
    })
}

fn read_patient(row: &Row) -> Result<Option<PatientDigest>, StoreError> {
    let digest: Option<String> = row.get("patient")?;
    let read = |digest: String| PatientDigest::from_hex(&digest);
    digest
        .map(|digest| read(digest).ok_or_else(|| unreadable("a patient")))
        .transpose()
}

/// The column `accession_number`.
pub fn read_accession_number(row: &Row) -> Result<Option<AccessionNumber>, StoreError> {
    let number: Option<String> = row.get("accession_number")?;
    Ok(number.as_deref().and_then(AccessionNumber::parse))
}

/// The columns `study_uid` and `series_uid`.
pub fn read_uids(row: &Row) -> Result<SeriesUids, StoreError> {
    Ok(SeriesUids {
        study: read_uid(row, "study_uid")?,
        series: read_uid(row, "series_uid")?,
    })
}

/// A column with a case.
pub fn read_case(row: &Row, column: &str) -> Result<Option<CaseId>, StoreError> {
    let id: Option<String> = row.get(column)?;
    id.map(|id| CaseId::parse(&id).ok_or_else(|| unreadable("a case")))
        .transpose()
}
