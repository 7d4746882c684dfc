"""The table of data sets against names seen in archives."""

from datetime import date, timedelta

import pytest

from bella.archive import DATASETS, Dataset, find_datasets
from bella.exceptions import InputError

SEEN = {
    "WI_H1_WAV": "pub/data/wind/waves/wav_h1/2020/wi_h1_wav_20200711_v01.cdf",
    "WI_L2_WAV_RAD1": "pub/data/wind/waves/rad1_l2/2020/wi_l2_wav_rad1_20200711_v01.cdf",
    "WI_L2_WAV_RAD2": "pub/data/wind/waves/rad2_l2/2020/wi_l2_wav_rad2_20200711_v02.cdf",
    "WI_K0_WAV": "pub/data/wind/waves/wav_k0/2020/wi_k0_wav_20200711_v01.cdf",
    "WI_WA_RAD1_L3_DF": "pub/data/wind/waves/rad1_l3_df/2020/wi_wa_rad1_l3_df_20200711_v02.cdf",
    "STEREO_LEVEL2_SWAVES": "pub/data/stereo/combined/swaves/level2_cdf/2020/stereo_level2_swaves_20200711_v02.cdf",
    "STA_L3_WAV_HFR": "pub/data/stereo/ahead/l3/waves/hfr-direction-finding/2020/sta_l3_wav_hfr_20200711_v01.cdf",
    "STA_L3_WAV_LFR": "pub/data/stereo/ahead/l3/waves/lfr/2020/sta_l3_wav_lfr_20200711_v01.cdf",
    "STB_L3_WAV_HFR": "pub/data/stereo/behind/l3/waves/hfr/2020/stb_l3_wav_hfr_20200711_v01.cdf",
    "PSP_FLD_L2_RFS_HFR": "pub/data/psp/fields/l2/rfs_hfr/2020/psp_fld_l2_rfs_hfr_20200711_v03.cdf",
    "PSP_FLD_L3_RFS_LFR": "pub/data/psp/fields/l3/rfs_lfr/2020/psp_fld_l3_rfs_lfr_20200711_v03.cdf",
    "SOLO_L2_RPW-HFR-SURV": (
        "pub/data/solar-orbiter/rpw/science/l2/hfr-surv/2020/solo_L2_rpw-hfr-surv_20200711_V05.cdf"
    ),
    "SOLO_L3_RPW-TNR-SURV-FLUX": (
        "pub/data/solar-orbiter/rpw/science/l3/tnr-surv-flux/2020/solo_L3_rpw-tnr-surv-flux_20200711_V01.cdf"
    ),
}
DAY = date(2020, 7, 11)


@pytest.mark.parametrize("key", SEEN)
def test_names_and_folders_are_those_of_the_archive(key: str) -> None:
    (dataset,) = find_datasets([key])
    folder, _, name = SEEN[key].rpartition("/")
    assert folder in dataset.folders(DAY)
    version = dataset.version(name, DAY)
    assert version is not None
    assert version[0] == int(name[-6:-4])
    assert dataset.version(name, DAY + timedelta(days=1)) is None


@pytest.mark.parametrize(
    "name", ["", "wi_h1_wav_20200711.cdf", "wi_h1_wav_20200711_v.cdf", "wi_h1_wav_20200711_v01.cdf\n", "WI_H1_WAV"]
)
def test_other_names_are_not_files_of_the_day(name: str) -> None:
    assert find_datasets(["wi_h1_wav"])[0].version(name, DAY) is None


@pytest.mark.parametrize("dataset", DATASETS, ids=lambda dataset: dataset.key)
def test_every_row_makes_sense(dataset: Dataset) -> None:
    first = dataset.first
    assert dataset.covers(first)
    assert not dataset.covers(first - timedelta(days=1))
    assert dataset.last is None or not dataset.covers(dataset.last + timedelta(days=1))
    assert dataset.due(first) > first
    assert dataset.cadence_s > 0
    assert all(folder.endswith(f"/{first.year}") for folder in dataset.folders(first))
    assert dataset.version(dataset.name.format(date=f"{first:%Y%m%d}", version="1.2.3"), first) == (1, 2, 3)


def test_no_file_belongs_to_two_data_sets() -> None:
    names = [dataset.name.format(date="20200711", version="01") for dataset in DATASETS]
    for name in names:
        assert [dataset.version(name, DAY) is not None for dataset in DATASETS].count(True) == 1
    assert len({dataset.key for dataset in DATASETS}) == len(DATASETS) == 18


def test_only_native_wind_needs_neighbours() -> None:
    assert [dataset.key for dataset in DATASETS if dataset.neighbours(DAY)] == ["WI_L2_WAV_RAD1", "WI_L2_WAV_RAD2"]
    rad1 = find_datasets(["WI_L2_WAV_RAD1"])[0]
    assert rad1.neighbours(rad1.first) == (rad1.first + timedelta(days=1),)


def test_an_unknown_data_set_is_refused_with_the_known_ones() -> None:
    with pytest.raises(InputError, match="'WI_X' is not known; choose from WI_H1_WAV, "):
        find_datasets(["WI_H1_WAV", "WI_X"])
    assert find_datasets([]) == DATASETS
