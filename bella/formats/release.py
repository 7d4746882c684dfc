"""What a data release says of itself: its record, its columns, and metadata for DataCite and Croissant.

Metadata follow DataCite 4.6 (https://schema.datacite.org) and Croissant 1.0 (http://mlcommons.org/croissant/1.0).
"""

import re
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import Field

from bella.flags import APPARENT_SOURCE
from bella.formats.columns import SCHEMAS, Column, Schema
from bella.records import Origin, Record

PAPER_DOI = "10.1051/0004-6361/202347747"
SOFTWARE = "The BELLA service developers"
DOI = re.compile(r"10\.\d{4,9}/\S+")
PARQUET_TYPE = "application/x-parquet"

Json = dict[str, Any]


class Release(Record):
    """A frozen catalogue: what it holds, of what, when, by which code, and whose it is."""

    release: str = Field(description="Label of the release.")
    made_utc: str = Field(description="Moment that the catalogue is frozen at.")
    code_version: str = Field(description="Version of bella-service that wrote the release.")
    catalogue_revision: str
    first_day: str | None = Field(default=None, description="First day of onsets that was asked for; null for all.")
    last_day: str | None = None
    origins: tuple[Origin, ...]
    first_onset_utc: str
    last_onset_utc: str
    rows: dict[str, int] = Field(description="Rows of each table.")
    posteriors: int = Field(description="Posteriors in the folder posteriors.")
    creators: tuple[str, ...]
    publisher: str
    licence: str = Field(description="Of the data, as SPDX names it.")
    doi: str | None = None

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"bella-{self.release}"

    @property
    def title(self) -> str:
        """Title as it is cited."""
        return f"BELLA catalogue of solar Type III radio bursts, release {self.release}"

    @property
    def abstract(self) -> str:
        """What it is, in a few sentences."""
        return (
            f"{self.rows.get('bursts', 0)} solar Type III radio bursts from {self.first_onset_utc[:10]} to "
            f"{self.last_onset_utc[:10]}, localised by Bayesian multilateration of their arrival times at several "
            f"spacecraft. Positions are HEE, in solar radii, of the {APPARENT_SOURCE}. Tables of bursts, tracks, "
            "localisations, arrival times, detections and searched days, with the posteriors behind them."
        )

    @property
    def licence_url(self) -> str:
        """Address of the text of the licence."""
        return f"https://spdx.org/licenses/{self.licence}.html"

    @property
    def citation(self) -> str:
        """How to cite it, in one line."""
        where = f", https://doi.org/{self.doi}" if self.doi else ""
        return f"{'; '.join(self.creators)} ({self.made_utc[:4]}): {self.title}. {self.publisher}{where}"


def json_schema(schemas: Iterable[Schema]) -> Json:
    """JSON Schema of one row of each table, with unit, UCD and meaning of every column."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Rows of the tables of a BELLA release",
        "$defs": {one.name: _row_schema(one) for one in schemas},
    }


def _row_schema(schema: Schema) -> Json:
    return {
        "title": schema.title,
        "type": "object",
        "properties": {one.name: _column_schema(one) for one in schema.columns},
        "required": list(schema.names),
        "additionalProperties": False,
    }


def _column_schema(column: Column) -> Json:
    kinds: dict[str, Json] = {
        "time": {"type": ["string", "null"], "format": "date-time"},
        "float": {"type": ["number", "null"]},
        "int": {"type": "integer"},
        "bool": {"type": "boolean"},
        "text": {"type": "string"},
    }
    unit = {"unit": column.unit} if column.unit else {}
    return kinds[column.kind] | {"description": column.description, "ucd": column.ucd} | unit


def datacite(release: Release) -> Json:
    """Metadata for a DOI by DataCite 4.6, as JSON; without a DOI where there is none yet."""
    found: Json = {"doi": release.doi} if release.doi else {}
    return found | {
        "creators": [_named(one) for one in release.creators],
        "titles": [{"title": release.title}],
        "publisher": {"name": release.publisher},
        "publicationYear": release.made_utc[:4],
        "types": {"resourceType": "Catalogue", "resourceTypeGeneral": "Dataset"},
        "subjects": [{"subject": one} for one in ("solar radio bursts", "Type III", "heliosphere", "multilateration")],
        "dates": [
            {"date": release.made_utc, "dateType": "Created"},
            {
                "date": f"{release.first_onset_utc[:10]}/{release.last_onset_utc[:10]}",
                "dateType": "Collected",
                "dateInformation": "Onsets of the first and the last burst",
            },
        ],
        "language": "en",
        "version": release.release,
        "formats": ["application/vnd.apache.parquet", "application/x-votable+xml", "application/vnd+zarr"],
        "rightsList": [
            {
                "rights": release.licence,
                "rightsUri": release.licence_url,
                "rightsIdentifier": release.licence,
                "rightsIdentifierScheme": "SPDX",
                "schemeUri": "https://spdx.org/licenses/",
            }
        ],
        "descriptions": [{"description": release.abstract, "descriptionType": "Abstract"}],
        "alternateIdentifiers": [{"alternateIdentifier": release.name, "alternateIdentifierType": "Release"}],
        "relatedIdentifiers": [
            {"relatedIdentifier": PAPER_DOI, "relatedIdentifierType": "DOI", "relationType": "IsDescribedBy"}
        ],
        "schemaVersion": "http://datacite.org/schema/kernel-4",
    }


def _named(name: str) -> Json:
    """A person where the name has a comma (family, given), otherwise an organisation."""
    family, comma, given = (part.strip() for part in name.partition(","))
    if not comma:
        return {"name": name, "nameType": "Organizational"}
    return {"name": f"{family}, {given}", "nameType": "Personal", "familyName": family, "givenName": given}


_CONTEXT: Json = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    **{
        name: f"cr:{name}"
        for name in (
            *("citeAs", "column", "equivalentProperty", "extract", "field", "fileProperty", "fileObject", "fileSet"),
            *("format", "includes", "isLiveDataset", "jsonPath", "key", "md5", "parentField", "path", "recordSet"),
            *("references", "regex", "repeated", "replace", "samplingRate", "separator", "source", "subField"),
            "transform",
        )
    },
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "rai": "http://mlcommons.org/croissant/RAI/",
    "sc": "https://schema.org/",
}
"""The context of Croissant 1.0, which readers compare word by word."""

_CROISSANT_TYPES = {"time": "sc:DateTime", "float": "sc:Float", "int": "sc:Integer", "bool": "sc:Boolean"}


def croissant(release: Release, sums: Mapping[str, str]) -> Json:
    """Metadata by Croissant 1.0 (JSON-LD): the files, and the columns of the tables as fields of record sets.

    Parameters
    ----------
    sums : mapping
        SHA-256 of each file that is described on its own, by its path in the release.
    """
    tables = [SCHEMAS[name] for name, rows in release.rows.items() if rows]
    files = [
        {
            "@type": "cr:FileObject",
            "@id": path,
            "name": path,
            "contentUrl": path,
            "encodingFormat": "text/csv" if path.endswith(".csv") else "application/x-votable+xml",
            "sha256": sha256,
        }
        for path, sha256 in sums.items()
    ]
    sets = [
        {
            "@type": "cr:FileSet",
            "@id": f"{one.name}-parquet",
            "name": f"{one.name}-parquet",
            "description": f"{one.title}: one file for each month.",
            "encodingFormat": PARQUET_TYPE,
            "includes": f"{one.name}/*.parquet",
        }
        for one in tables
    ]
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": release.name,
        "description": release.abstract,
        "version": release.release,
        "datePublished": release.made_utc[:10],
        "license": release.licence_url,
        "citeAs": release.citation,
        "url": f"https://doi.org/{release.doi}" if release.doi else "index.html",
        "creator": [
            {"@type": "sc:Person" if "," in one else "sc:Organization", "name": one} for one in release.creators
        ],
        "distribution": [*files, *sets],
        "recordSet": [_record_set(one) for one in tables],
    }


def _record_set(schema: Schema) -> Json:
    return {
        "@type": "cr:RecordSet",
        "@id": schema.name,
        "name": schema.name,
        "description": schema.title,
        "field": [
            {
                "@type": "cr:Field",
                "@id": f"{schema.name}/{one.name}",
                "name": one.name,
                "description": f"{one.description} Unit: {one.unit}" if one.unit else one.description,
                "dataType": _CROISSANT_TYPES.get(one.kind, "sc:Text"),
                "source": {"fileSet": {"@id": f"{schema.name}-parquet"}, "extract": {"column": one.name}},
            }
            for one in schema.columns
        ],
    }
