"""Studies: questions put to the engine, each a library call that gives tables and pictures.

::

    from insgnss.studies import hidden_satellite_variance, masking_study

    study = hidden_satellite_variance("sokolov_2015", imu="tactical", oscillator="tcxo", outage="bank")
    study.at([79, 100, 101, 110]); study.figure(); study.save("out/")

    cases = masking_study("sokolov_2015", runs=20)
    cases.cases, cases.false_locks, cases.reacquisition; cases.save("out/")

    found = consistency_study(run)                       # a run or its folder
    found.verdict, found.kinds, found.noise_factors; found.figure(); found.save("out/")

    study = outage_study("flight.toml", Periodic(length_s=30.0, every_s=60.0), Removal(constellations=("R",)))
    study.percentiles, study.windows; study.save("out/")

    grid = manoeuvre_study("sokolov_2015", imus=("tactical", "industrial"))
    grid.cases; grid.heat_map(); grid.save("out/")

    study = receiver_study("manoeuvring_5g", imu="industrial", cn0=[40, 30, 25, 20])
    study.summary, study.thresholds; study.figure(); study.save("out/")
    receiver_study(**receiver_request("out/"))           # repeats the saved study

    flight = MatchedFlight.of("tactical", "tcxo")
    covariance_analysis(flight).sd, monte_carlo(flight, 500).nees

    study = sample_receiver(simulate("steep_turns"))     # samples of GPS L1 C/A through loops with and without aiding
    study.summary, study.channels; study.save("out/")

    if __name__ == "__main__":                           # the workers are processes that import the script
        run_campaign("campaign.toml", "out/")
    summary("out/", by=("case",))
"""

from __future__ import annotations

from insgnss.studies.campaign.results import data_set, failures, summary
from insgnss.studies.campaign.study import CampaignConfig, CampaignDone, load_campaign, run_campaign
from insgnss.studies.consistency.study import Consistency, consistency_study
from insgnss.studies.manoeuvre.hidden_variance import HiddenVariance, hidden_satellite_variance
from insgnss.studies.manoeuvre.study import ManoeuvreStudy, manoeuvre_study
from insgnss.studies.masking.study import MaskingStudy, masking_study
from insgnss.studies.matched_flight import MatchedFlight, MonteCarlo, covariance_analysis, monte_carlo
from insgnss.studies.outage.study import Banked, OutageStudy, Periodic, Random, outage_study
from insgnss.studies.outage.windows import Removal
from insgnss.studies.receiver.comparison import ReceiverStudy, receiver_study
from insgnss.studies.receiver.manoeuvring_covariance import ManoeuvringReceiver
from insgnss.studies.receiver.options import ReceiverOptions
from insgnss.studies.receiver.saved_request import receiver_request
from insgnss.studies.receiver.slips import SlipRuns, slip_runs
from insgnss.studies.receiver.variants import VARIANTS as RECEIVERS
from insgnss.studies.receiver.variants import Variant
from insgnss.studies.samples.study import SampleStudy, record_samples, sample_receiver

__all__ = [
    "Banked",
    "CampaignConfig",
    "CampaignDone",
    "Consistency",
    "HiddenVariance",
    "ManoeuvreStudy",
    "ManoeuvringReceiver",
    "MaskingStudy",
    "MatchedFlight",
    "MonteCarlo",
    "OutageStudy",
    "Periodic",
    "Random",
    "RECEIVERS",
    "ReceiverOptions",
    "ReceiverStudy",
    "Removal",
    "SampleStudy",
    "SlipRuns",
    "Variant",
    "consistency_study",
    "covariance_analysis",
    "data_set",
    "failures",
    "hidden_satellite_variance",
    "load_campaign",
    "manoeuvre_study",
    "masking_study",
    "monte_carlo",
    "outage_study",
    "receiver_request",
    "receiver_study",
    "record_samples",
    "run_campaign",
    "sample_receiver",
    "slip_runs",
    "summary",
]
