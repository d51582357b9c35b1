using System.Collections.Generic;
using UnityEngine;

namespace Tensionlab
{
    /// <summary>Shots that kick the hand along the object's y; call Shoot.</summary>
    [AddComponentMenu("Tensionlab/Recoil")]
    public class RecoilEffect : HapticEffect
    {
        const int Kept = 4;

        [Min(0f), Tooltip("Largest force F_p of a shot, in N.")]
        public float peak = 5.5f;
        [Min(0.0001f), Tooltip("Time t_r in which the force rises, in s.")]
        public float rise = 0.005f;
        [Min(0.0001f), Tooltip("Time constant tau with which it fades, in s.")]
        public float fade = 0.06f;

        readonly List<object> shots = new List<object>();

        /// <summary>Shoot now, or nearly so: the time is that of the run's latest state.</summary>
        public void Shoot()
        {
            if (bridge == null || bridge.State == null) return;
            shots.Add(bridge.State.Time);
            if (shots.Count > Kept) shots.RemoveAt(0);
        }

        protected override string Kind { get { return "recoil"; } }

        protected override void Describe(Dictionary<string, object> parameters, RigFrame rig)
        {
            parameters["shots"] = shots;
            parameters["direction"] = rig.Direction(transform.up);
            parameters["peak"] = peak;
            parameters["rise"] = rise;
            parameters["fade"] = fade;
        }
    }
}
