"""Merge of the shards of a campaign, or of campaigns that differ only in their seed."""

from collections.abc import Sequence
from pathlib import Path

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.experiment import check_user_code
from abhv_mc.campaign.file.requirement_set import judge_by
from abhv_mc.execution.executor import check_source
from abhv_mc.execution.runner import RunResult, run_campaign
from abhv_mc.folder.hashes import record_hashes
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.lock import hold_lock
from abhv_mc.folder.manifest import read_manifest
from abhv_mc.folder.merge import (
    check_poolable,
    join_shards,
    order_shards,
    pool_campaigns,
    require_same_requirements,
)
from abhv_mc.folder.requirement_sets import replace_requirements
from abhv_mc.interfaces import Engine
from abhv_mc.requests import Request


def merge_campaign(
    parts: Sequence[Path],
    out: Path,
    engine: Engine | None = None,
    trust_code: bool = False,
    requirements: Path | None = None,
) -> RunResult:
    """Merge complete shards, or campaigns that differ only in their seeds, into ``out``.

    The envelopes, histories and verdicts of all flights are created too. The same call resumes an
    interrupted merge. ``trust_code`` permits custom code in the folders to run although the user
    has not run it before. ``requirements`` is a file with the requirements for all flights; it must
    be given if the parts have different requirements. Raise InputError, before files are created,
    if the parts belong to different campaigns, were run with different code or plans, or share
    flights.
    """
    sharded = read_manifest(CampaignFolder(parts[0]).manifest).shard is not None
    folders = order_shards(parts) if sharded else check_poolable(parts)
    campaign = read_campaign(folders[0].campaign, engine=engine)
    if requirements is None:
        require_same_requirements(folders)
    else:
        campaign = judge_by(campaign, requirements)
    check_source(folders[0], read_manifest(folders[0].manifest), campaign.simulator)
    check_user_code(campaign, trust_code)  # A merge re-runs the flights whose histories are stored.
    target = CampaignFolder(out)
    with hold_lock(target.lock):
        (join_shards if sharded else pool_campaigns)(folders, out)
        if requirements is not None:
            manifest = read_manifest(target.manifest)
            with record_hashes(target, manifest.files) as files:
                replace_requirements(target, manifest, files, campaign.document.entries)
    return run_campaign(Request(target.campaign, out, trust_code=trust_code), engine)
