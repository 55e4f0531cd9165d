-- Failures no longer hold the numbers of HTTP: `status` becomes `kind`, and what was `kind` is the failure's `name`.
UPDATE cases SET failure = json_object(
    'name', json_extract(failure, '$.kind'),
    'kind', CASE json_extract(failure, '$.status')
                WHEN 409 THEN 'cancelled'
                WHEN 413 THEN 'too_large'
                WHEN 415 THEN 'not_recognised'
                WHEN 422 THEN 'unusable'
                WHEN 501 THEN 'not_supported'
                WHEN 503 THEN 'out_of_memory'
                ELSE 'internal'
            END,
    'detail', json_extract(failure, '$.detail')
) WHERE failure IS NOT NULL;
