//! The images that cases and layers were made of, and whether these are closed: a word of [`Tables::judge`](crate::tables::Tables::judge).

use case::CaseId;
use case::images::{Closed, Fingerprint, Image};
use case::series::Uid;

use super::connection::{Connection, Row, unreadable};
use crate::StoreError;
use crate::args;
use crate::rows::Made;

/// Writes of which images something was made. If it is there, and was made of other images with the same UIDs, those count that were sent
/// last.
pub async fn make(
    connection: &mut Connection,
    made: &Made,
    images: &[Image],
) -> Result<(), StoreError> {
    let tables = connection.tables();
    for image in images {
        let last = tables.last_sent(connection, &image.uid).await?;
        let print = as_it_is_known(connection, &image.uid, &image.fingerprint, last.as_ref());
        let print = print.await?;
        connection
            .execute(
                "INSERT INTO made_of (case_id, layer_id, result_id, sop_instance_uid, fingerprint, times)
                 VALUES ($1, $2, $3, $4, $5, $6)
                 ON CONFLICT (case_id, layer_id, result_id, sop_instance_uid) DO UPDATE
                 SET fingerprint = excluded.fingerprint,
                     times = CASE WHEN excluded.times > made_of.times THEN excluded.times ELSE made_of.times END
                 WHERE $7",
                args![
                    &made.case, &made.layer, &made.result, image.uid.as_str(), print.to_string(),
                    i64::try_from(image.times).unwrap_or(i64::MAX), last.as_ref() == Some(&print),
                ],
            )
            .await?;
    }
    tables.judge(connection, made).await
}

/// A fingerprint as the rows have it, if something is made of the same image, or that was the last one: a corner may differ by rounding.
pub async fn as_it_is_known(
    connection: &mut Connection,
    image: &Uid,
    fingerprint: &Fingerprint,
    last: Option<&Fingerprint>,
) -> Result<Fingerprint, StoreError> {
    let rows = connection
        .fetch_all(
            "SELECT DISTINCT fingerprint FROM made_of WHERE sop_instance_uid = $1",
            args![image.as_str()],
        )
        .await?;
    let of_others = rows.iter().map(read_fingerprint);
    let of_others = of_others.collect::<Result<Vec<_>, _>>()?;
    let mut known = last.into_iter().chain(of_others.iter().flatten());
    let known = known.find(|known| known.is_same(fingerprint));
    Ok(known.unwrap_or(fingerprint).clone())
}

/// Lets a version be made of the images of its case.
pub(super) async fn inherit(
    connection: &mut Connection,
    case: &CaseId,
    previous: &CaseId,
) -> Result<(), StoreError> {
    connection
        .execute(
            "INSERT INTO made_of (case_id, sop_instance_uid, fingerprint, times)
             SELECT $1, sop_instance_uid, fingerprint, times FROM made_of
             WHERE case_id = $2 AND layer_id = '' AND result_id = '' ON CONFLICT DO NOTHING",
            args![case.to_string(), previous.to_string()],
        )
        .await?;
    let tables = connection.tables();
    tables.judge(connection, &Made::case(case)).await
}

/// Lets the layers of a version be made of the images of those of its case. The columns `closed` are copied with the layers.
pub(super) async fn inherit_layers(
    connection: &mut Connection,
    case: &CaseId,
    previous: &CaseId,
) -> Result<(), StoreError> {
    connection
        .execute(
            "INSERT INTO made_of (case_id, layer_id, sop_instance_uid, fingerprint, times)
             SELECT $1, layer_id, sop_instance_uid, fingerprint, times FROM made_of
             WHERE case_id = $2 AND result_id = '' AND layer_id IN (SELECT id FROM layers WHERE case_id = $1) ON CONFLICT DO NOTHING",
            args![case.to_string(), previous.to_string()],
        )
        .await?;
    Ok(())
}

/// Forgets of which images something was made.
pub async fn forget(connection: &mut Connection, made: &Made) -> Result<(), StoreError> {
    connection
        .execute(
            "DELETE FROM made_of WHERE case_id = $1 AND layer_id = $2 AND result_id = $3",
            args![&made.case, &made.layer, &made.result],
        )
        .await?;
    Ok(())
}

/// The images that something was made of, by UID.
pub async fn of(connection: &mut Connection, made: &Made) -> Result<Vec<Image>, StoreError> {
    let rows = connection
        .fetch_all(
            "SELECT sop_instance_uid, fingerprint, times FROM made_of
             WHERE case_id = $1 AND layer_id = $2 AND result_id = $3 ORDER BY sop_instance_uid",
            args![&made.case, &made.layer, &made.result],
        )
        .await?;
    let read = |row: &Row| {
        Ok(Image {
            uid: read_uid(row, "sop_instance_uid")?,
            fingerprint: read_fingerprint(row)?.ok_or_else(|| unreadable("a fingerprint"))?,
            times: row.get::<i64>("times")?.unsigned_abs(),
        })
    };
    rows.iter().map(read).collect()
}

/// The column `fingerprint`; `None` if its image cannot be decoded.
pub fn read_fingerprint(row: &Row) -> Result<Option<Fingerprint>, StoreError> {
    let text: String = row.get("fingerprint")?;
    match &*text {
        "" => Ok(None),
        text => Fingerprint::parse(text)
            .map(Some)
            .ok_or_else(|| unreadable("a fingerprint")),
    }
}

/// A column with a UID.
pub fn read_uid(row: &Row, column: &str) -> Result<Uid, StoreError> {
    let text: String = row.get(column)?;
    Uid::parse(&text).ok_or_else(|| unreadable("a UID"))
}

/// A column `closed`.
pub fn read_closed(row: &Row, column: &str) -> Result<Option<Closed>, StoreError> {
    Ok(match row.get::<Option<i64>>(column)? {
        None | Some(0) => None,
        Some(1) => Some(Closed::Rejected),
        Some(_) => Some(Closed::Corrected),
    })
}
