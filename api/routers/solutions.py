"""Single solutions, and their Zarr groups as files: what is under these addresses never changes."""

from fastapi import APIRouter, Response
from fastapi.responses import FileResponse

from api.freshness import IMMUTABLE
from api.schemas import SolutionReply
from api.service import CatalogueHere, ServiceHere
from bella.store import group_file

router = APIRouter(prefix="/api/v1/solutions", tags=["solutions"])


@router.get("/{solution_id}")
def solution(solution_id: str, catalogue: CatalogueHere) -> SolutionReply:
    """One solution."""
    return SolutionReply.of(catalogue.solution(solution_id))


@router.head("/{solution_id}/posterior.zarr/{key:path}", include_in_schema=False)
@router.get("/{solution_id}/posterior.zarr/{key:path}", response_class=Response)
def posterior_file(solution_id: str, key: str, service: ServiceHere) -> FileResponse:
    """One file of the Zarr group of a solution; ``xarray.open_zarr`` takes this address without the key."""
    group = service.catalogue().solution(solution_id).store_path
    path = group_file(service.settings.store_root, group, key)
    kind = "application/json" if path.suffix == ".json" else "application/octet-stream"
    return FileResponse(path, media_type=kind, headers={"Cache-Control": IMMUTABLE})
